"""Data, form and results are there again after a reload, a lost tab, a server that was killed, and one that stopped."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import time
from pathlib import Path

import pytest
from tests.support.sample_results import table2
from tests.support.serving import VIBRIDENT, WAIT_MS, choose, download, field, serving, simulated, upload

from vibrident.fit.registry import ESTIMATORS

ROWS = "time,reference,response\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50))


def filled(page, folder) -> None:
    """Data, an answer in the form, and a result."""
    (folder / "a.csv").write_text(ROWS)
    upload(page, folder / "a.csv", table2().save(folder / "earlier.json"))
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    field(page, "Serial number").fill("4711")
    page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
    page.wait_for_timeout(1000)  # it is written within a second


def is_there(page) -> None:
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    assert field(page, "Serial number").input_value() == "4711"
    assert page.get_by_role("listitem").all_inner_texts() == ["a.csv\nclose"]
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
    page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.slow
def test_a_reload_loses_nothing_a_closed_tab_is_offered_in_the_next_and_to_start_anew_asks(
    browser, server, picture, tmp_path, width
):
    contexts = [browser.new_context(viewport={"width": width, "height": 844}) for _ in range(2)]
    mine, other = contexts
    page, asked = mine.new_page(), []
    page.on("dialog", lambda dialog: (asked.append(dialog.type), dialog.accept()))
    page.goto(server.address)
    filled(page, tmp_path)
    page.reload()
    is_there(page)
    if width == 390:  # as after a reload
        page.goto("about:blank")
        page.go_back()
        is_there(page)
    assert not asked
    assert page.locator("#gone").count() == 0
    page.close()
    stranger = other.new_page()
    stranger.goto(server.address)
    stranger.get_by_text("No data yet.").wait_for()
    assert stranger.locator("#left-work").count() == 0

    page = mine.new_page()
    page.goto(server.address)
    page.get_by_role("button", name="1 file, 1 result").first.wait_for(timeout=WAIT_MS)
    picture(page, f"left-work-{width}")
    page.get_by_role("button", name="1 file, 1 result").first.focus()
    page.keyboard.press("Enter")
    is_there(page)
    assert page.locator("#left-work").count() == 0
    start_anew_asks(page, picture)
    for context in contexts:
        context.close()


def start_anew_asks(page, picture) -> None:
    """And removes the result too."""
    for answer in ("Keep", "Remove all"):
        page.get_by_role("button", name="Start anew").click()
        page.get_by_text("Remove 1 file, the form and 1 result from the page?").wait_for()
        picture(page, f"anew-{answer[:4]}")
        page.get_by_role("button", name=answer, exact=True).click()
        page.get_by_text("Remove 1 file").wait_for(state="detached")
        assert page.locator("#result").is_visible() == (answer == "Keep")
    page.get_by_text("No data yet.").wait_for()
    assert not page.locator("#columns").is_visible()
    page.get_by_role("button", name="Start anew").click()  # there is nothing to ask for
    page.get_by_text("No data yet.").wait_for()


@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.slow
def test_a_server_that_ended_in_the_middle_of_a_fit_is_followed_by_one_that_has_it_all(
    browser, picture, tmp_path, ending
):
    context = browser.new_context()
    page = context.new_page()
    with serving(tmp_path, *VIBRIDENT, "serve", "--port", "0", ending=ending) as first:
        port = first.address.rstrip("/").rpartition(":")[2]
        page.goto(first.address)
        page.get_by_role("heading", name="Data").wait_for()
        upload(page, *simulated(tmp_path / "made"), table2().save(tmp_path / "earlier.json"))
        page.locator("#confirm").wait_for(timeout=WAIT_MS)
        page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
        field(page, "Serial number").fill("4711")
        page.locator("#confirm").click()
        choose(page, "Estimator", f"ml: {ESTIMATORS['ml'].title}")
        choose(page, "Uncertainties cover", "noise: the noise alone")
        page.locator("#start").click()
        page.get_by_role("button", name="Cancel").wait_for()
        page.wait_for_timeout(700)
    with serving(tmp_path, *VIBRIDENT, "serve", "--port", port):
        page.get_by_text("The server was stopped during the identification.").wait_for(timeout=WAIT_MS)
        page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
        picture(page, "restarted")
        assert field(page, "Serial number").input_value() == "4711"
        assert len(page.locator("#data").get_by_role("listitem").all()) == len(list((tmp_path / "made").glob("*.csv")))
        asked = "--estimator ml --uncertainty noise"
        assert page.locator("#broken-off").inner_text() == f"Broken off: vibrident identify calibration.toml {asked}"
        page.locator("#repeat").click()
        page.locator("#status").get_by_text("Identified.", exact=True).wait_for(timeout=WAIT_MS)
        page.locator("#get-json").wait_for(timeout=WAIT_MS)
        assert page.locator("#command .plain").text_content().endswith(asked)
        found = json.loads(download(page, "json"))
        assert found["estimator"] == "ml"
    context.close()


@pytest.mark.slow
def test_repeat_repeats_what_ran_though_the_form_has_changed_and_process_and_server_were_killed(browser, tmp_path):
    """What ran is the calibration file of that moment with its estimator, not what the form says now."""
    context = browser.new_context()
    page = context.new_page()
    with serving(tmp_path, *VIBRIDENT, "serve", "--port", "0", ending=signal.SIGKILL) as first:
        port = first.address.rstrip("/").rpartition(":")[2]
        page.goto(first.address)
        page.get_by_role("heading", name="Data").wait_for()
        upload(page, *simulated(tmp_path / "made"))
        page.locator("#confirm").wait_for(timeout=WAIT_MS)
        field(page, "Serial number").fill("4711")
        page.locator("#confirm").click()
        choose(page, "Estimator", f"ml: {ESTIMATORS['ml'].title}")
        page.locator("#start").click()
        page.get_by_role("button", name="Cancel").wait_for()
        kill_computation(first.process.pid)
        page.get_by_text("The computation was ended before it was done.").wait_for(timeout=WAIT_MS)
        field(page, "Serial number").fill("9999")
        page.wait_for_timeout(1000)  # it is written within a second
    with serving(tmp_path, *VIBRIDENT, "serve", "--port", port):
        page.get_by_text("The computation was ended before it was done.").wait_for(timeout=WAIT_MS)
        assert field(page, "Serial number").input_value() == "9999"
        choose(page, "Estimator", "auto: chosen by the data")
        page.locator("#repeat").click()
        page.locator("#status").get_by_text("Identified.", exact=True).wait_for(timeout=WAIT_MS)
        page.locator("#get-json").wait_for(timeout=WAIT_MS)
        document = json.loads(download(page, "json"))
        assert document["estimator"] == "ml"
        assert document["sensor"]["serial_number"] == "4711"
    context.close()


def kill_computation(server: int) -> None:
    """End the process of the identification, which loads its libraries first, as a lack of memory does."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                fields = stat.read_text().rpartition(")")[2].split()
                folder = (stat.parent / "cwd").readlink()
                if int(fields[1]) == server and "run-" in folder.name:
                    os.kill(int(stat.parent.name), signal.SIGKILL)
                    return
        time.sleep(0.05)
    raise AssertionError("there is no process of an identification")


@pytest.mark.slow
def test_where_nothing_is_kept_the_page_says_what_is_lost(browser, picture, tmp_path):
    context = browser.new_context()
    page = context.new_page()
    with serving(tmp_path, *VIBRIDENT, "serve", "--keep", "0", "--port", "0") as first:
        port = first.address.rstrip("/").rpartition(":")[2]
        page.goto(first.address)
        page.get_by_role("heading", name="Data").wait_for()
        (tmp_path / "a.csv").write_text(ROWS)
        upload(page, tmp_path / "a.csv")
        page.locator("#confirm").wait_for(timeout=WAIT_MS)
    with serving(tmp_path, *VIBRIDENT, "serve", "--keep", "0", "--port", port):
        page.locator("#gone").wait_for(timeout=WAIT_MS)
        page.get_by_text("No data yet.").wait_for(timeout=WAIT_MS)
        picture(page, "gone")
    context.close()

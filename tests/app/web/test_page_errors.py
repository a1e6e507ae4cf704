"""What goes wrong with people, files and connections, in a real browser: nothing is lost or hidden in silence."""

from __future__ import annotations

import os
import re
import signal
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.support.serving import WAIT_MS, choose, field, simulated, start_anew, upload

ROWS = "time,reference,response\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50))


def calibration(page) -> str:
    """The calibration file that the page would identify with."""
    return page.locator("#calibration-text .plain").text_content()


def files(page) -> int:
    return int(page.locator("#files").inner_text().split()[0])


def test_of_a_folder_what_is_not_known_is_left_out_and_listed(visit, picture, tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    for i in range(17):
        (folder / f"{i}_0Hz.csv").write_text(ROWS)
    (folder / "notes.docx").write_bytes(b"PK")
    (folder / "photo.JPG").write_bytes(b"\xff\xd8")
    page = visit()
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose a folder").click()
    chooser.value.set_files(folder)
    page.locator("#left-out").wait_for(timeout=WAIT_MS)
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    assert files(page) == 17
    told = page.locator("#left-out").inner_text()
    assert told.startswith("2 files were left out")
    assert {"notes.docx", "photo.JPG"} <= set(re.findall(r"[\w.]+", told))
    picture(page, "left-out")


@pytest.mark.slow
def test_of_more_files_than_a_page_takes_the_rest_is_left_out_and_listed(visit, tmp_path):
    for i in range(507):
        (tmp_path / f"{i}.csv").write_text(ROWS)
    page = visit()
    upload(page, *sorted(tmp_path.iterdir()))
    page.get_by_text("7 files were left out").wait_for(timeout=WAIT_MS)
    page.get_by_text("500 files:").wait_for()
    page.locator("#confirm").wait_for(timeout=WAIT_MS)


def test_edits_after_confirm_reach_identify_and_files_added_wipe_no_form(visit, tmp_path):
    (tmp_path / "a.csv").write_text(ROWS)
    (tmp_path / "0.csv").write_text(ROWS.replace("reference", "velocity [mm/s]"))
    page = visit()
    upload(page, tmp_path / "a.csv")
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    page.locator("#confirm").click()
    page.get_by_text("The calibration file: as confirmed above").click()
    field(page, "Serial number").fill("4711")
    field(page, "Response: scale").fill("2.5")
    choose(page, "Model", "velocity-pickup")
    page.wait_for_function("document.querySelector('#calibration-text').textContent.includes('velocity-pickup+delay')")
    assert all(text in calibration(page) for text in ('serial_number = "4711"', "scale = 2.5"))

    field(page, "Response: scale").fill("")
    page.get_by_text("“Response: scale” is empty.").wait_for()
    assert page.locator("#start").is_disabled()
    field(page, "Response: scale").fill("3")
    page.get_by_text("“Response: scale” is empty.").wait_for(state="detached")
    assert page.locator("#start").is_enabled()

    upload(page, tmp_path / "0.csv")  # it comes first now, and its names say something else
    page.locator("#files").get_by_text("2 files").wait_for(timeout=WAIT_MS)
    page.get_by_text("your settings are kept").wait_for(timeout=WAIT_MS)
    page.locator("#start").wait_for(state="hidden")
    page.locator("#confirm").wait_for()
    assert field(page, "Serial number").input_value() == "4711"
    assert field(page, "Response: scale").input_value() == "3"
    page.locator("#confirm").click()
    page.locator("#start").wait_for()
    text = calibration(page)
    assert 'model = "velocity-pickup+delay"' in text
    assert text.count("[[records]]") == 2
    page.get_by_role("button", name="remove 0.csv").click()
    page.get_by_text("1 file:").wait_for(timeout=WAIT_MS)
    page.locator("#start").wait_for(state="hidden")


@pytest.mark.slow
def test_what_the_form_does_not_ask_is_written_as_text(visit, picture, tmp_path):
    (tmp_path / "a.csv").write_text(ROWS)
    page = visit()
    upload(page, tmp_path / "a.csv")
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    field(page, "Serial number").fill("4711")
    page.locator("#edit-text").press("Enter")
    written = field(page, "Calibration file")
    whole = written.input_value()
    written.fill(whole.replace('excitation = "random"', 'excitation = "wobble"'))
    page.locator("#use-text").press("Enter")
    page.locator("#columns").get_by_role("alert").get_by_text("wobble").first.wait_for(timeout=WAIT_MS)
    written.fill(whole + "start_s = 0.1\nstop_s = 0.4\n")
    picture(page, "as-text")
    page.locator("#use-text").press("Enter")
    page.get_by_text("calibration.toml came with the data").wait_for(timeout=WAIT_MS)
    page.locator("#confirm").press("Enter")
    page.locator("#start").wait_for()
    assert "stop_s = 0.4" in calibration(page)
    page.get_by_role("button", name="remove calibration.toml").click()
    page.locator("#edit-text").wait_for(timeout=WAIT_MS)
    assert field(page, "Serial number").input_value() == "4711"


@pytest.mark.slow
def test_a_worker_that_is_killed_is_told_of_and_can_be_repeated(visit, picture, server, tmp_path):
    page = visit()
    upload(page, *simulated(tmp_path))
    page.locator("#confirm").click(timeout=WAIT_MS)
    page.locator("#start").click()
    page.get_by_role("button", name="Cancel").wait_for()
    os.kill(wait_for_worker(server.process.pid), signal.SIGKILL)
    alert = page.get_by_role("alert")
    alert.wait_for(timeout=WAIT_MS)
    picture(page, "killed")
    assert "signal 9, SIGKILL" in alert.inner_text()
    assert "signal 9, SIGKILL" in server.log.read_text()
    page.locator("#repeat").click()
    page.get_by_text("Identified.").wait_for(timeout=WAIT_MS)


def wait_for_worker(server: int) -> int:
    """The process that identifies."""
    children = Path(f"/proc/{server}/task")
    while True:
        for thread in children.iterdir():
            for child in (thread / "children").read_text().split():
                arguments = Path(f"/proc/{child}/cmdline").read_text()
                if "vibrident.base.process" in arguments and "vibrident.app.web.column_guess" not in arguments:
                    return int(child)
        time.sleep(0.02)


def many_columns(folder: Path) -> Path:
    names = ",".join(f"c{i}" for i in range(50_000))
    (place := folder / "wide.csv").write_text(f"{names}\n" + (",".join(["1.5"] * 50_000) + "\n") * 3)
    return place


def many_datasets(folder: Path) -> Path:
    with h5py.File(place := folder / "many.h5", "w", libver="latest") as file:
        for i in range(20_000):
            file.create_dataset(f"d{i}", data=np.zeros(1))
    return place


@pytest.mark.slow
@pytest.mark.parametrize("make", [many_columns, many_datasets])
def test_what_is_beyond_all_measure_is_told_of_and_the_page_goes_on(visit, tmp_path, make):
    page = visit()
    upload(page, make(tmp_path))
    page.locator("#confirm, [role=alert]").first.wait_for(timeout=WAIT_MS)
    start_anew(page)
    page.get_by_text("No data yet.").wait_for()
    (tmp_path / "a.csv").write_text(ROWS)
    upload(page, tmp_path / "a.csv")
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)

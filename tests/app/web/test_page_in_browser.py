"""The whole way in a real browser."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from pypdf import PdfReader
from tests.support.contrast import texts, too_faint
from tests.support.real_data import real_data
from tests.support.serving import WAIT_MS, choose, download, field, upload
from tests.support.shell import printed, run


def shell(folder: Path, shown: str) -> dict:
    """Run the command that the page shows."""
    printed(*shlex.split(shown)[1:], "--no-pictures", "--out", "out", folder=folder)
    return json.loads((folder / "out" / "result.json").read_text())


def alike(document: dict) -> dict:
    """What does not depend on when it was made and how long it took."""
    settings = {key: value for key, value in document["settings"].items() if key != "time_s"}
    provenance = {key: value for key, value in document["provenance"].items() if key != "time"}
    return {**document, "settings": settings, "provenance": provenance}


def agrees_with_the_command(page, folder: Path) -> None:
    """What is downloaded is, to the last digit, what the command shown on the page gives in the folder of the data."""
    page.get_by_text("The same in a shell").click()
    (folder / "calibration.toml").write_bytes(download(page, "toml"))
    taken = download(page, "json")
    assert alike(json.loads(taken)) == alike(shell(folder, page.locator("#command .plain").inner_text()))

    (folder / "taken.json").write_bytes(taken)
    (folder / "page.pdf").write_bytes(download(page, "pdf"))
    printed("report", "out/result.json", "--format", "pdf", "--out", "shell", folder=folder)
    (written,) = (folder / "shell").glob("*.pdf")
    said = [words_and_numbers(path) for path in (folder / "page.pdf", written)]
    assert said[0] == said[1]
    assert len(re.findall(r"\d", said[0])) > 100


def words_and_numbers(pdf: Path) -> str:
    """The text of a PDF, but for the second in which the result was made."""
    text = "".join(sheet.extract_text() for sheet in PdfReader(pdf).pages)
    return re.sub(r"\d{4}-\d\d-\d\dT[\d:]+\+00:00", "", text)


@pytest.mark.slow
def test_real_files_give_the_numbers_of_the_command_line(visit, picture, tmp_path):
    data = real_data("sm3")
    names = ["1_0Hz.csv", "2_0Hz.csv", "3_0Hz.csv", "5_0Hz.csv", "10_0Hz.csv"]
    page = visit()
    upload(page, *(data / name for name in names))
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    choose(page, "Reference: column", "FuncGen")
    choose(page, "Reference: quantity", "drive, its own unit")
    field(page, "Reference: scale").fill("0.9425e-6")
    field(page, "Reference: unit").fill("V")
    choose(page, "Response: column", "Laser")
    field(page, "Response: scale").fill("0.95066e-9")
    field(page, "Response: unit").fill("m")
    page.locator("#show").click()
    page.locator("#columns .js-plotly-plot").wait_for()
    picture(page, "columns")
    page.locator("#confirm").click()
    choose(page, "Estimator", "ipnn: the physics-informed network")
    choose(page, "Discretisation (ipnn)", "foh")
    choose(page, "Uncertainties cover", "noise: the noise alone")
    page.locator("#start").click()
    page.get_by_text("Identified.").wait_for(timeout=WAIT_MS)
    page.locator("#result .js-plotly-plot").first.wait_for()
    picture(page, "result")

    for name in names:
        (tmp_path / name).symlink_to(data / name)
    agrees_with_the_command(page, tmp_path)
    assert not too_faint(page)


@pytest.mark.slow
def test_two_users_stay_apart_and_errors_are_those_of_the_command_line(visit, picture, tmp_path):
    broken = tmp_path / "broken.csv"
    broken.write_text("time,reference,response\n0.0,1.0,2.0\n0.1,oops,2.0\n0.2,1.0,2.5\n0.3,1.0,2.0\n")
    one, other = visit(), visit(390, 844)
    upload(one, broken)
    one.get_by_text("A cell that must hold a number holds text.").wait_for()
    assert one.get_by_text("broken.csv, line 3, column 2 ('reference')").is_visible()
    picture(one, "broken")
    assert not too_faint(one)
    assert other.locator("#files").inner_text().strip() in ("", "No data yet.")

    other.get_by_role("button", name="Load the simulated demo").click()
    other.locator("#confirm").wait_for(timeout=WAIT_MS)
    other.locator("#confirm").focus()
    other.keyboard.press("Enter")
    other.locator("#start").wait_for()
    other.locator("#start").focus()
    other.keyboard.press("Enter")
    other.get_by_text("Identified.").wait_for(timeout=WAIT_MS)
    picture(other, "phone")
    assert other.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert not too_faint(other)
    assert not one.locator("#result").is_visible()
    assert one.locator("#data").get_by_role("listitem").all_inner_texts() == ["broken.csv\nclose"]


def test_a_file_of_an_unknown_kind_is_refused_in_words(visit, tmp_path):
    pickle = tmp_path / "data.npy"
    pickle.write_bytes(b"\x93NUMPY")
    page = visit()
    upload(page, pickle)
    page.get_by_text("The file's format is not known.").wait_for()


def test_a_broken_calibration_file_gets_the_message_of_the_command_line(visit, tmp_path):
    (tmp_path / "a.csv").write_text("time,reference,response\n0.0,1.0,2.0\n0.1,1.5,2.0\n0.2,1.0,2.5\n")
    (tmp_path / "calibration.toml").write_text("[reference]\ncolumn = \n")
    said = run("identify", "calibration.toml", folder=tmp_path).stderr
    page = visit()
    upload(page, tmp_path / "a.csv", tmp_path / "calibration.toml")
    shown = page.get_by_role("alert")
    shown.wait_for(timeout=WAIT_MS)
    assert re.sub(r"\W+", " ", said).split()[-len(re.findall(r"\w+", shown.inner_text())) :] == re.findall(
        r"\w+", shown.inner_text()
    )
    assert "Traceback" not in page.content()
    assert not page.locator("#confirm").is_visible()

    (tmp_path / "calibration.toml").write_text(
        "[reference]\ncolumn = 2\n[response]\ncolumn = 3\n[sampling]\ntime_column = 1\n"
        '[[records]]\nfile = "a.csv"\nexcitation = "random"\n'
    )
    upload(page, tmp_path / "calibration.toml")
    page.get_by_text("calibration.toml came with the data").wait_for(timeout=WAIT_MS)


@pytest.mark.slow
def test_what_was_confirmed_does_not_pass_for_a_calibration_file_of_the_user(visit, tmp_path):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("time,reference,response\n0.0,1.0,2.0\n0.1,1.5,2.0\n0.2,1.0,2.5\n")
    page = visit()
    upload(page, tmp_path / "a.csv")
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
    page.wait_for_timeout(500)  # plotly complains where a plot goes while it is drawn
    for _ in range(2):
        page.locator("#confirm").click(timeout=WAIT_MS)
        page.locator("#start").wait_for()
    upload(page, tmp_path / "b.csv")
    page.locator("#files").get_by_text("2 files").wait_for()
    page.locator("#start").wait_for(state="hidden")
    page.get_by_text("Guessed from the names in a.csv").wait_for()
    assert "calibration.toml" not in page.locator("#data").get_by_role("list").inner_text()


def upload_simulated(page, folder: Path) -> None:
    """A short calibration of known truth, its columns to be guessed."""
    made = "--samples 2000 --rate 12800 --frequencies 100,250,400,630,1000 --seed 4 --response-noise 0.01"
    printed(*shlex.split(f"simulate --out . {made}"), folder=folder)
    (folder / "calibration.toml").rename(folder / "as-simulated.toml")
    upload(page, *sorted(folder.glob("*.csv")))
    page.locator("#confirm").wait_for(timeout=WAIT_MS)


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.quick("1280")
def test_by_keyboard_alone_from_files_to_a_result_that_agrees_with_the_command(visit, picture, press, tmp_path, width):
    """Without the real data too. Every stop of the tabulator is visible, and all that is done is done by keys."""
    page = visit(width, 844)
    picture(page, f"empty-{width}")
    assert len(texts(page)) >= 6
    assert not too_faint(page)
    upload_simulated(page, tmp_path)
    press(page, "#confirm", "#columns")
    press(page, "#start", "#identify")
    page.get_by_text("Identified.").wait_for(timeout=WAIT_MS)
    page.locator("#result .js-plotly-plot").first.wait_for()
    page.get_by_text("How it was found").click()
    page.locator("#how .js-plotly-plot").wait_for(timeout=WAIT_MS)
    picture(page, f"simulated-{width}")
    assert not too_faint(page)
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    stops_are_seen(page)
    if width == 1280:
        agrees_with_the_command(page, tmp_path)


@pytest.mark.slow
def test_two_photodetectors_are_drawn_over_each_other_and_identified(visit, sound, press, tmp_path):
    settings = "--samples 12000 --rate 400000 --frequencies 160,400,1000 --start steady --seed 3 --response-noise 0.001"
    printed(*shlex.split(f"simulate --interferometer quadrature --out . {settings}"), folder=tmp_path)
    (tmp_path / "calibration.toml").rename(tmp_path / "as-simulated.toml")
    page = visit()
    upload(page, *sorted(tmp_path.glob("*.h5")))
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
    page.get_by_label("Sampling rate, Hz", exact=True).fill("400000")
    choose(page, "Direction of x", "x grows with the phase")
    press(page, "#show", "#columns")
    page.locator("#columns .js-plotly-plot .xtitle").first.wait_for(timeout=WAIT_MS)
    sound(page, "light")
    assert page.locator("#columns .js-plotly-plot .xtitle").first.text_content() == "First signal"
    press(page, "#confirm", "#columns")
    press(page, "#start", "#identify")
    page.get_by_text("Identified.").wait_for(timeout=WAIT_MS)
    found = json.loads(download(page, "json"))
    truth = json.loads((tmp_path / "truth.json").read_text())
    for name, stated in truth["parameters"].items():
        parameter = found["parameters"][name]
        assert abs(parameter["value"] - stated["value"]) < 4.0 * parameter["standard_uncertainty"]
    assert max(row["fringes"] for row in found["settings"]["interferometer"].values()) > 10.0


def stops_are_seen(page) -> None:
    """The outline, or the border of the field, of whatever has the focus."""
    page.locator("#data").evaluate("section => { section.tabIndex = -1; section.focus(); }")
    for _ in range(25):
        page.keyboard.press("Tab")
        page.wait_for_timeout(30)
        seen = page.evaluate(
            """() => {
              const at = document.activeElement, field = at.closest('.q-field');
              const line = getComputedStyle(at);
              return at === document.body || (line.outlineStyle !== 'none' && parseFloat(line.outlineWidth) >= 2)
                || (field !== null && field.classList.contains('q-field--focused'));
            }"""
        )
        assert seen, page.evaluate("document.activeElement.outerHTML.slice(0, 200)")

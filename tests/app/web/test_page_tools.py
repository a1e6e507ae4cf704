"""Further tasks on the page: tables and charts by the library, and refusals in the words of the page."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import pytest
from tests.support.contrast import too_faint
from tests.support.serving import choose, download, simulated, upload
from tests.support.shell import printed

WAIT_MS = 240_000


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> list[Path]:
    return simulated(tmp_path_factory.mktemp("made") / "data", "--frequencies", "50,100,200,400,600,800,1000")


@pytest.fixture
def identified(visit, made):
    """A page with data and a result."""

    def fill():
        page = visit()
        upload(page, *made)
        page.locator("#confirm").click(timeout=WAIT_MS)
        page.locator("#start").click()
        page.get_by_text("Identified.").wait_for(timeout=WAIT_MS)
        page.locator("#result .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
        return page

    return fill


def ran(page, task: str) -> str:
    """Run a task as it stands; what it says."""
    if page.get_by_label("Task", exact=True).input_value() != task:
        choose(page, "Task", task)
    page.locator("#task-start:not([disabled])").press("Enter", timeout=WAIT_MS)  # the one before is wholly done
    page.locator("#get-all").wait_for(state="detached")
    page.locator("#get-all").wait_for(timeout=WAIT_MS)
    assert page.locator("#task-status").inner_text() == "Done."
    return page.locator("#said").inner_text()


def files(page) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(download(page, "all"))) as packed:
        return {name: packed.read(name) for name in packed.namelist()}


@pytest.mark.slow
def test_predict_correct_track_and_plan(identified, picture, violations, made):
    page = identified()
    steps = ["Data", "Columns, units and model", "Laboratory and uncertainty", "Identify", "Result"]
    steps += ["More with these data"]  # that of the sensors follows when they are read
    assert page.get_by_role("navigation", name="Contents").get_by_role("link").all_inner_texts()[:6] == steps
    with zipfile.ZipFile(io.BytesIO(download(page, "everything"))) as packed:
        names = set(packed.namelist())
    assert {"result.json", "calibration.toml"} <= names
    assert {name.rpartition(".")[2] for name in names} >= {"pdf", "html", "md", "csv"}
    ran(page, "Predict")
    packed = files(page)
    assert len([name for name in packed if name.endswith(".csv")]) == len(made)
    assert b'"rmse"' in packed["prediction.json"]
    json.loads(packed["prediction.json"])
    ran(page, "Correct")
    assert "correction.json" in files(page)
    picture(page, "corrected")
    ran(page, "Plan the next calibration")
    assert "plan.json" in files(page)
    picture(page, "planned")
    ran(page, "Track")
    assert "track.csv" in files(page)
    assert violations(page) == []
    assert too_faint(page) == []


@pytest.mark.slow
def test_models_are_chosen_from_a_list_and_a_task_can_be_cancelled(visit, made, sound):
    page = visit()
    upload(page, *made)
    page.locator("#confirm").click(timeout=WAIT_MS)
    page.locator("#start").wait_for()
    picked(page, "Models", "accelerometer+delay", "accelerometer")
    page.locator("#task-start").press("Enter")
    page.locator("#task-chart .js-plotly-plot").wait_for(timeout=WAIT_MS)  # while it computes
    page.locator("#task-cancel").press("Enter")
    page.locator("#task-status").get_by_text("Cancelled.").wait_for(timeout=WAIT_MS)
    said = ran(page, "Compare models and estimators")
    assert "Choice of the model" in said
    assert "accelerometer+delay" in said
    page.reload()
    page.locator("#get-all").wait_for(timeout=WAIT_MS)  # what it made is there again
    sound(page, "more")
    choose(page, "Task", "Predict")
    page.locator("#task-start").click()
    page.get_by_text("Something is missing for this task.").wait_for()


@pytest.mark.slow
def test_an_option_out_of_range_is_refused_by_its_label(identified):
    page = identified()
    choose(page, "Task", "Plan the next calibration")
    page.get_by_label("Choose the best N of them").fill("2.5")
    page.locator("#task-start").press("Enter")
    alert = page.locator("#more").get_by_role("alert")
    alert.wait_for(timeout=WAIT_MS)
    assert "“Choose the best N of them”" in alert.inner_text()
    page.get_by_label("Choose the best N of them").fill("3")
    page.get_by_label("Frequencies: from, Hz").fill("100")
    page.locator("#task-start").press("Enter")
    page.get_by_text("“Frequencies: from, Hz”").first.wait_for(timeout=WAIT_MS)
    page.get_by_label("Frequencies: to, Hz").fill("900")
    assert "-optimal choice of 3" in ran(page, "Plan the next calibration")


def picked(page, label: str, *options: str) -> None:
    """Choose several from a list."""
    page.get_by_label(label, exact=True).click()
    for option in options:
        page.get_by_role("option", name=option, exact=True).click()
    page.keyboard.press("Escape")


@pytest.mark.slow
def test_calibration_files_of_their_own_make_a_joint_fit_and_a_fleet(visit, sound, press, tmp_path):
    for seed in ("1", "2"):
        folder = tmp_path / seed
        folder.mkdir()
        words = ("--samples", "2000", "--rate", "12800", "--seed", seed, "--frequencies", "100,200,400,800")
        printed("simulate", "--out", ".", *words, folder=folder)
        for path in folder.glob("*.csv"):
            path.rename(tmp_path / f"{seed}_{path.name}")
        text = (folder / "calibration.toml").read_text().replace('file = "', f'file = "{seed}_')
        (tmp_path / f"{seed}.toml").write_text(text)
    page = visit()
    upload(page, *tmp_path.glob("*.csv"), *tmp_path.glob("*.toml"))
    page.get_by_text("use them all under").wait_for(timeout=WAIT_MS)
    ran(page, "Fit several calibrations together")
    assert {"result.json", "2/result.json"} <= set(files(page))
    page.locator("#compare .js-plotly-plot").first.wait_for(timeout=WAIT_MS)
    sound(page, "joint")
    said = ran(page, "Identify many sensors")
    assert "identified" in said
    assert str(tmp_path) not in said
    assert "fleet.parquet" in files(page)
    sound(page, "fleet")
    press(page, "#get-all", "#more")

"""The history on the page: results are added to the store, and what it holds of their sensor is shown."""

from __future__ import annotations

import pytest
from tests.support.lives import calibrated
from tests.support.serving import upload

from vibrident.lab.histories import History
from vibrident.lab.history import query
from vibrident.lab.history.store import Store

WAIT_MS = 60_000


@pytest.mark.slow
def test_results_are_added_and_their_history_is_shown(visit, sound, press, history_store, tmp_path):
    life = [calibrated(0.1 * (1 + 0.001 * i), f"{2012 + 2 * i}-05-01", serial="on the page") for i in range(5)]
    with History(history_store) as history:
        history.add(life[:4])
    for name, result in (("last", life[4]), ("nameless", calibrated(serial=""))):
        result.save(tmp_path / f"{name}.json")
    page = visit()
    upload(page, tmp_path / "last.json")
    page.get_by_text("The history holds 4 calibrations of this sensor.").wait_for(timeout=WAIT_MS)
    press(page, "#add-to-history", "#result")
    page.get_by_text("holds 5 calibrations of this sensor.").wait_for(timeout=WAIT_MS)
    page.locator("#history .js-plotly-plot").first.wait_for()
    assert page.locator("#history").get_by_text("2020-05-01").first.is_visible()
    sound(page, "history")
    with Store(history_store) as store:
        sensor = query.find(store, "on the page")
        assert len(query.entries(store, sensor.id)[sensor.id]) == 5
    press(page, "#approve", "#result")
    page.get_by_text("is approved. The history holds 5").wait_for(timeout=WAIT_MS)
    with Store(history_store) as store:
        assert "approved" in str(query.entries(store, sensor.id)[sensor.id][-1])
    upload(page, tmp_path / "nameless.json")
    page.get_by_text("holds no calibration").wait_for(timeout=WAIT_MS)
    page.locator("#add-to-history").click()
    page.get_by_text("does not state the serial number").wait_for(timeout=WAIT_MS)


@pytest.mark.slow
def test_sensors_have_their_dates_and_work_is_found_by_its_serial_number(visit, sound, press, history_store, tmp_path):
    lives = {"A-17": "2024-05-01", "A-18": "2026-05-01"}
    for serial, date in lives.items():
        with History(history_store) as history:
            history.add(calibrated(serial=serial, date=date))
        calibrated(serial=serial, date=date).save(tmp_path / f"{serial}.json")
    page = visit()
    page.locator("#sensors-words").get_by_text("in the history").wait_for(timeout=WAIT_MS)
    upload(page, tmp_path / "A-17.json", tmp_path / "A-18.json")
    page.get_by_role("list", name="Open drafts").get_by_text("A-18").first.wait_for(timeout=WAIT_MS)
    page.get_by_label("Find a serial number").fill("a-17")
    press(page, "#find-serial", "#sensors")
    page.locator("#sensors-words").get_by_text("1 sensor in the history, 1 open draft.").wait_for(timeout=WAIT_MS)
    row = page.locator("#sensors-body tbody tr")
    assert row.count() == 1
    cells = row.locator("td").all_inner_texts()
    assert cells[0] == "A-17"
    assert cells[2] == "2024-05-01"
    assert cells[4] == "2025-05-01"  # a year, the interval where there is one calibration
    assert "overdue" in cells[5]
    sound(page, "sensors")
    page.get_by_role("button", name="Open A-17").press("Enter")
    page.locator("#result").get_by_text("A-17").first.wait_for(timeout=WAIT_MS)

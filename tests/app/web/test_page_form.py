"""The form of the columns asks for what a calibration file can state."""

from __future__ import annotations

import pytest
from tests.support.serving import WAIT_MS, choose, field, upload

from vibrident.app.web.form.description import ENTRIES, KEYS, SECTIONS
from vibrident.data.io.keys import keys_of

ROWS = "time,reference,response\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50))


def test_the_form_reaches_every_key_but_those_that_need_a_table_or_come_from_the_files():
    stated = {f"{section}.{name}" for section, one in SECTIONS.items() for name in keys_of(one.section)}
    reached = {path for path, key in KEYS.items() if key.level in ("basic", "more")}
    reached |= {f"{section}.{key.name}" for section in ("records", "uncertainty", "cmc") for key in ENTRIES[section]}
    signals = {"interferometer.columns.0", "interferometer.columns.1"}
    known = {"reference.known_response", "response.known_response"}
    assert stated - reached == {"interferometer.columns", "table.file", *known}
    assert reached - stated == signals
    assert all(key.level for key in KEYS.values())


@pytest.mark.slow
def test_what_is_asked_for_less_often_reaches_the_calibration_file(visit, sound, press, tmp_path):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(ROWS)
    page = visit()
    upload(page, tmp_path / "a.csv", tmp_path / "b.csv")
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
    press(page, "#more-keys", "#columns")
    field(page, "Part of the record: to, s").fill("0.4")
    field(page, "Temperature of the sensor, °C").fill("23")
    page.get_by_role("button", name="Add record").press("Enter")
    choose(page, "File", "b.csv")
    row = page.get_by_role("group", name="Record 1")
    row.get_by_label("Run", exact=True).fill("2")
    row.get_by_label("Temperature of the sensor, °C").fill("24")
    page.get_by_role("button", name="Add source").press("Enter")
    field(page, "Source").fill("laser")
    choose(page, "Kind", "gain")
    page.get_by_role("button", name="Add capability").press("Enter")
    field(page, "Least U (k = 2)").fill("1")
    sound(page, "more")
    page.locator("#confirm").press("Enter")
    alert = page.locator("#columns").get_by_role("alert")
    alert.get_by_text("“Standard uncertainty” of source 1 is empty.").wait_for(timeout=WAIT_MS)
    field(page, "Standard uncertainty").fill("0.1")
    page.locator("#confirm").press("Enter")
    page.locator("#start").wait_for(timeout=WAIT_MS)
    page.reload()
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    press(page, "#more-keys", "#columns")
    page.get_by_role("group", name="Record 1").get_by_label("Run", exact=True).fill("3")
    page.get_by_text("The calibration file: as confirmed above").click()
    page.wait_for_function("document.querySelector('#calibration-text').textContent.includes('run = \"3\"')")
    text = page.locator("#calibration-text .plain").text_content()
    first, second = text.split("[[records]]")[1:]
    assert "stop_s = 0.4" in first
    assert "temperature_c = 23.0" in first
    assert "temperature_c = 24.0" in second
    assert "run" not in first
    assert "standard_uncertainty = 0.001" in second.split("[[uncertainty]]")[1]
    assert "expanded_uncertainty = 0.01" in second.split("[[cmc]]")[1]

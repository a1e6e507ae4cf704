"""Sources in the form: U with its k, and bands, are what the calibration file can say, and come back."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.serving import WAIT_MS, field, upload

from vibrident.app.web.form.description import ENTRIES
from vibrident.app.web.form.entries import filled
from vibrident.app.web.form.sources import applies, bands_of, entry_in_file, entry_in_form, source_keys, table_of
from vibrident.data.io.sections import UncertaintyEntry, check_uncertainties

ROWS = "time,reference,response\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(50))


def of_file(row):
    """The entry of a calibration file, checked as the reader checks it."""
    entry = UncertaintyEntry(**entry_in_file(row))
    check_uncertainties([entry], "here")
    return entry


@pytest.mark.parametrize("k", [1.0, 2.0, 1.96, 3.18])
def test_an_expanded_uncertainty_is_k_times_what_the_file_states(k):
    row = {"stated_as": "U", "source": "laser", "kind": "gain", "expanded_uncertainty": 0.012, "coverage_factor": k}
    assert of_file(row).standard_uncertainty == pytest.approx(0.012 / k, rel=1e-14)
    usual = {name: value for name, value in row.items() if name != "coverage_factor"}
    assert of_file(usual).standard_uncertainty == 0.006


def test_a_table_comes_back_from_its_bands():
    rng = np.random.default_rng(4)
    for _ in range(200):
        frequencies = np.cumsum(rng.uniform(0.1, 50.0, rng.integers(1, 9))).round(3)
        values = rng.choice([0.001, 0.002, 0.005], len(frequencies))
        table = [[float(f), float(u)] for f, u in zip(frequencies, values, strict=True)]
        assert table_of(bands_of(table)) == table


def test_bands_that_touch_have_their_own_values_up_to_the_edge():
    bands = [{"from_hz": 10.0, "to_hz": 1000.0, "value": 0.005}, {"from_hz": 1000.0, "to_hz": 5000.0, "value": 0.01}]
    table = table_of(bands)
    assert bands_of(table) == bands
    row = {"stated_as": "table", "source": "reference", "kind": "gain", "table": table}
    rows = of_file(row).effect.pattern
    size = of_file(row).effect.standard_uncertainty
    at = np.interp([10.0, 300.0, 999.9, 1000.1, 4000.0], [f for f, _, _ in rows], [size * part for _, part, _ in rows])
    assert at == pytest.approx([0.005, 0.005, 0.005, 0.01, 0.01], rel=1e-6)
    assert entry_in_form(entry_in_file(row)) == row


def test_a_band_without_a_value_is_refused_by_name():
    from vibrident.base.errors import InputError
    from vibrident.data.io.calibration_file import checked_calibration

    entry = entry_in_file({"stated_as": "table", "source": "a", "kind": "gain", "table": table_of([{"from_hz": 10.0}])})
    with pytest.raises(InputError) as caught:
        checked_calibration({"uncertainty": [entry]}, "form")
    assert "[[uncertainty]]" in caught.value.where
    assert "pairs of frequency in Hz and value" in caught.value.expected


def test_values_by_frequency_are_asked_for_in_the_unit_of_their_kind():
    table = next(key for key in source_keys() if key.name == "table")
    assert filled(table, [[10.0, 0.5], [20.0, None]], table.asked_in({"kind": "gain"})) == [[10.0, 0.005], [20.0, None]]
    (degrees,) = filled(table, [[10.0, 180.0]], table.asked_in({"kind": "phase"}))
    assert degrees[1] == pytest.approx(np.pi)


def test_a_form_asks_for_each_key_of_a_source_in_one_way():
    names = [key.name for key in source_keys()]
    assert {*names} - {key.name for key in ENTRIES["uncertainty"]} == {
        *("stated_as", "expanded_uncertainty", "coverage_factor")
    }
    sizes = ("standard_uncertainty", "expanded_uncertainty", "table")
    for way in ("u", "U", "table"):
        row = {"stated_as": way, "kind": "gain"}
        assert sum(applies(key, row) for key in source_keys() if key.name in sizes) == 1


@pytest.mark.slow
def test_sources_as_certificates_state_them_reach_the_calibration_file(visit, sound, press, tmp_path):
    (tmp_path / "a.csv").write_text(ROWS)
    page = visit()
    upload(page, tmp_path / "a.csv")
    page.locator("#columns .js-plotly-plot").wait_for(timeout=WAIT_MS)
    for _ in range(2):
        page.get_by_role("button", name="Add source").press("Enter")
    first, second = (page.get_by_role("group", name=f"Source {number}", exact=True) for number in (1, 2))
    for row, name, way in ((first, "laser", "U with k"), (second, "sensor", "by frequency")):
        row.get_by_label("Source", exact=True).fill(name)
        row.get_by_label("Kind").click()
        page.get_by_role("option", name="gain", exact=True).click()
        row.get_by_label("Stated as").click()
        page.get_by_role("option", name=way, exact=True).click()
    first.get_by_label("U", exact=True).fill("1.2")
    second.get_by_role("button", name="Add band").press("Enter")
    for number, values in enumerate((("10", "1000", "0.5"), ("1000", "5000", "1")), 1):
        band = second.get_by_role("group", name=f"Band {number}")
        for label, value in zip(("From, Hz", "To, Hz", "Standard uncertainty"), values, strict=True):
            band.get_by_label(label).fill(value)
    sound(page, "sources")
    page.locator("#confirm").press("Enter")
    page.get_by_text("The calibration file: as confirmed above").click()
    page.wait_for_function("document.querySelector('#calibration-text').textContent.includes('1000')")
    text = page.locator("#calibration-text .plain").text_content()
    one, two = text.split("[[uncertainty]]")[1:]
    assert "standard_uncertainty = 0.006" in one
    assert "expanded" not in text
    assert "stated_as" not in text
    assert "0.005" in two.split("table")[1]
    page.reload()
    page.locator("#confirm").wait_for(timeout=WAIT_MS)
    band = page.get_by_role("group", name="Source 2", exact=True).get_by_role("group", name="Band 2")
    band.wait_for(timeout=WAIT_MS)
    assert band.get_by_label("From, Hz").input_value() == "1000"
    assert band.get_by_label("Standard uncertainty").input_value() == "1"
    assert field(page, "Stated as").first.is_visible()

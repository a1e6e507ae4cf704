"""A document states a quantity in one unit, with the digits of its uncertainty and with the signs of print."""

import html
import io
import re
from dataclasses import replace

import numpy as np
import pypdf
import pytest
from tests.support.sample_results import table2

from vibrident.show import report, tables
from vibrident.show.comparison import ComparedQuantity, Value, difference
from vibrident.show.media import html as page
from vibrident.show.numbers import pair, percent
from vibrident.show.terminal import text


def at_the_step_of_a_prefix():
    """The parameter reads 1.0000 mV, most of the curve and of the points a little less; RMSE and MAE likewise."""
    made = table2()
    factor = 1.00003e-3 / made.parameters["sensitivity"].value
    gain = replace(
        made.parameters["sensitivity"], value=1.00003e-3, standard_uncertainty=1.1e-6, interval_95=(None, None)
    )
    measured = replace(made.measured, magnitude=0.99 * factor * np.minimum(made.measured.magnitude, 0.1))
    curve = replace(made.response, magnitude=0.99 * factor * np.minimum(made.response.magnitude, 0.1))
    fit = replace(made.fit, rmse=1.0001e-3, mae=0.81e-3)
    return replace(
        made, parameters={**made.parameters, "sensitivity": gain}, measured=measured, response=curve, fit=fit
    )


@pytest.fixture(scope="module")
def documents():
    result = at_the_step_of_a_prefix()
    return {
        "terminal": text(result),
        "markdown": report.render(result).replace("\\", ""),
        "html": html.unescape(page.printed(report.document.report(result))),
        "pdf": "".join(p.extract_text() for p in pypdf.PdfReader(io.BytesIO(report.content(result, "pdf"))).pages),
    }


def test_sensitivities_have_one_unit_in_a_document(documents):
    for name, words in documents.items():
        assert set(re.findall(r"[mµn]?V/\(m/s²\)", words)) == {"mV/(m/s²)"}, name


def test_rmse_and_mae_have_one_unit():
    rows = {row[0]: row[1:3] for row in tables.fit(at_the_step_of_a_prefix()).rows}
    assert rows["RMSE"] == ("1", "mV")
    assert rows["MAE"] == ("0.81", "mV")


def test_no_hyphen_stands_for_a_minus(documents):
    for name, words in documents.items():
        found = re.findall(r"(?:^|[\s(|>])[-]\d[\d.]*(?=[\s<|°)])", re.sub(r'"[^"]*"|<svg.*?</svg>', "", words))
        assert not found, (name, found[:5])
        assert "−" in words or name == "terminal"


def test_zero_has_neither_sign_nor_power():
    assert pair(-1e-9, 4.1e-6)[0] == "0"
    assert percent(1e-9, 4.1e-6) == "0 %"
    assert percent(-1e-12, 1e-3) == "0.0000 %"


def test_a_difference_of_nothing_is_zero():
    one = Value(0.1, 1e-9)
    assert difference(one, one, ComparedQuantity("", tables.scaled("V", 0.1), (one, one))) == "0 %"


def test_deviations_have_the_digits_of_their_uncertainty():
    made = table2().measured
    n = len(made.frequency_hz)
    known = {"deviation_uncertainty_percent": np.full(n, 0.031), "deviation_phase_uncertainty_deg": np.full(n, 0.22)}
    table = tables.measured(replace(table2(), measured=replace(made, **known)))
    places = {
        title: {len(row[j].removesuffix(" %").partition(".")[2]) for row in table.rows}
        for j, title in enumerate(table.header)
    }
    assert places["deviation"] == {3}  # U = 0.062 %
    assert places["deviation / °"] == {2}  # U = 0.44°

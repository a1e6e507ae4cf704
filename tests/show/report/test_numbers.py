import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.printed import typed

from vibrident.result import Parameter
from vibrident.show.numbers import concise, last_digit, pair, percent, plain, rounded_parameter


@pytest.mark.parametrize(
    ("value", "u", "texts"),
    [
        (652.0412, 0.118, ("652.04", "0.12")),
        (100.02147, 0.00035, ("100.02147", "0.00035")),  # GUM 7.2.2
        (10.05762, 0.027, ("10.058", "0.027")),  # GUM 7.2.6
        (0.18213, 0.0996, ("0.18", "0.10")),  # rounding up makes a digit
        (0.18213, 0.00994, ("0.1821", "0.0099")),
        (9.996, 0.0995, ("10.00", "0.10")),
        (1234.0, 45.0, ("1234", "45")),
        (123456.0, 4500.0, ("123500", "4500")),
        (0.03, 1.24, ("0.0", "1.2")),  # value smaller than u
        (-0.004, 1.24, ("0.0", "1.2")),  # no negative zero
        (0.0, 0.0123, ("0.000", "0.012")),
        (-3.2e-9, 4.1e-8, ("−0.3·10⁻⁸", "4.1·10⁻⁸")),
        (1.23456e-12, 2.1e-15, ("1.2346·10⁻¹²", "0.0021·10⁻¹²")),
        (1.23456e30, 4.56e27, ("1.2346·10³⁰", "0.0046·10³⁰")),
        (652.04, None, ("652.04", "–")),
        (652.0412345, None, ("652.041", "–")),
        (652.04, 0.0, ("652.04", "0")),
        (652.04, math.nan, ("652.04", "–")),
        (652.04, math.inf, ("652.04", "–")),
        (None, 0.12, ("–", "0.12")),
        (math.nan, None, ("–", "–")),
        (1.0, 1e-20, ("1", "1·10⁻²⁰")),  # finer than a float
    ],
)
def test_gum_rounding(value, u, texts):
    assert pair(value, u) == texts


@settings(max_examples=300, deadline=None)
@given(
    st.floats(-1e12, 1e12, allow_nan=False).filter(lambda v: v == 0 or abs(v) > 1e-12),
    st.floats(1e-9, 1e9),
)
def test_rounding_laws(value, u):
    text, u_text = map(typed, pair(value, u))
    if max(abs(value), u) / u > 1e13:
        return
    step = 10.0 ** last_digit(u)
    assert float(u_text) == pytest.approx(u, abs=0.5000001 * step)
    assert 9.5 <= round(float(u_text) / step) <= 99.5  # two significant digits
    assert float(text) == pytest.approx(value, abs=0.5000001 * step + 1e-9 * abs(value))
    if text == "0":
        return
    assert text.partition("e")[2] == u_text.partition("e")[2]
    decimals = [len(part.partition("e")[0].partition(".")[2]) for part in (text, u_text)]
    assert decimals[0] == decimals[1]


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        (104.042, 0.107, "104.04(11)"),
        (0.18213, 0.00021, "0.18213(21)"),
        (104.3, 1.24, "104.3(1.2)"),
        (1234.0, 45.0, "1234(45)"),
        (0.5, 0.0996, "0.50(10)"),
        (1.23456e-12, 2.1e-15, "1.2346(21)·10⁻¹²"),
        (2.5, None, "2.5"),
        (2.5, 0.0, "2.5"),
    ],
)
def test_concise(value, u, text):
    assert concise(value, u) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (4100.0, "4100"),
        (1.5e9, "1.5·10⁹"),
        (-1.5e-7, "−1.5·10⁻⁷"),
        (None, "–"),
        (1 / 3, "0.333333"),
    ],
)
def test_plain(value, text):
    assert plain(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.1234, "+0.12 %"),
        (-12.34, "−12 %"),
        (0.0, "0 %"),
        (1e-7, "+1.0·10⁻⁷ %"),
        (-4.12e-4, "−0.00041 %"),
        (2.1e-3, "+0.0021 %"),
        (None, "–"),
        (300.0, "+300 %"),
    ],
)
def test_percent(value, text):
    assert percent(value) == text


def test_stated_parameter_has_one_unit_for_all():
    number = rounded_parameter(Parameter(1.2382e-5, "s", 9.6e-8, (1.2194e-5, 1.257e-5)))
    assert (number.value, number.standard, number.expanded, number.unit) == ("12.382", "0.096", "0.19", "µs")
    assert number.interval == "12.194 … 12.570"


@pytest.mark.parametrize(
    ("interval", "text"),
    [((None, 0.31), "≤ 0.31"), ((0.1, None), "≥ 0.1"), ((None, None), "not bounded"), ((0.1, 0.3), "0.100 … 0.300")],
)
def test_open_intervals(interval, text):
    assert rounded_parameter(Parameter(0.2, "Hz", None, interval, identifiable=False)).interval == text


def test_no_uncertainty_at_all():
    number = rounded_parameter(Parameter(0.2, "1", None, (None, None)))
    assert (number.value, number.standard, number.expanded, number.interval, number.unit) == ("0.2", "–", "–", "–", "")

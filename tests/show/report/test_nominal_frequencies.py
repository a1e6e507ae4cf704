import math

import numpy as np
import pytest

from vibrident.base.nominal import choose_reference, nominal_frequencies, nominal_value
from vibrident.fit.uncertainty.curve import POINTS, frequencies

EXACT = [10 ** (n / 10) for n in range(10, 31)]


def names(items):
    return [item.name for item in items]


def test_the_names_are_those_of_iso_266():
    text = "10 12.5 16 20 25 31.5 40 50 63 80 100 125 160 200 250 315 400 500 630 800 1000"
    assert " ".join(names(nominal_frequencies(10, 1000))) == text
    assert nominal_value(-2) == 0.63
    assert nominal_value(38) == 6300.0


def test_a_nominal_frequency_is_the_exact_one_unless_the_data_are_literal():
    assert [item.frequency_hz for item in nominal_frequencies(10, 1000, EXACT)] == pytest.approx(EXACT, rel=1e-15)
    literal = [float(item.name) for item in nominal_frequencies(10, 1000)]
    assert [item.frequency_hz for item in nominal_frequencies(10, 1000, literal)] == literal
    gaps = {item.name: item.frequency_hz for item in nominal_frequencies(100, 500, [100.0, 125.0, 200.0, 300.0, 400.0])}
    assert gaps["160"] == 160.0  # one series for all, though nothing was measured at this one
    mixed = {item.name: item.frequency_hz for item in nominal_frequencies(100, 200, [100.0, 125.0, 10**2.2])}
    assert mixed["125"] == 10**2.1  # as many of either: the exact ones


def test_no_frequency_outside_the_band():
    assert names(nominal_frequencies(10.1, 49)) == ["12.5", "16", "20", "25", "31.5", "40"]
    assert names(nominal_frequencies(10.0 * (1 + 5e-5), 12)) == ["10"]  # a tone whose frequency was estimated
    assert nominal_frequencies(130, 150) == ()
    assert nominal_frequencies(0.0, 10.0) == ()


@pytest.mark.parametrize(
    ("band", "stated", "nominal", "words"),
    [
        ((10, 1000), None, 160.0, "default"),
        ((0.01, 50), None, 1.0, "160 Hz lies outside"),
        ((200, 5000), None, 1000.0, "nearest to its middle"),
        ((130, 150), None, None, "no nominal"),
        ((10, 1000), 80.0, 80.0, "as stated"),
        ((10, 1000), 159.155, 159.155, "as stated"),
        ((10, 100), 160.0, None, "160 Hz lies outside"),
    ],
)
def test_the_reference_frequency(band, stated, nominal, words):
    item, why = choose_reference(*band, stated_hz=stated)
    assert (item and item.nominal_hz) == nominal
    assert words in why


@pytest.mark.parametrize("band", [(10.0, 1000.0), (10.00003, 999.97), (0.004, 51.2), (3.0, 20000.0), (159.0, 170.0)])
def test_the_curve_holds_every_certified_frequency(band):
    grid = frequencies(band, (), 159.155)
    assert grid.size == POINTS
    assert np.all(np.diff(grid) > 0)
    for item in nominal_frequencies(*band):
        assert item.frequency_hz in grid
    if band[0] < 159.155 < band[1]:
        assert 159.155 in grid
    assert math.isclose(grid[0], band[0], rel_tol=1e-4)
    assert math.isclose(grid[-1], band[1], rel_tol=1e-4)
    assert np.diff(np.log(grid)).max() < 2 * math.log(band[1] / band[0]) / (POINTS - 1)

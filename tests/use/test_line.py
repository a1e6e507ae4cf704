"""A line through values of known uncertainty, and the run outside the scatter of the others: rates, coverage, names."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from vibrident.fit.uncertainty.parameters import coverage_factor
from vibrident.use.line import LinePoints, explanations, fit_line
from vibrident.use.outliers import find_outlier

DRAWS = 2000
REJECTION = 1e-3


def points(rng, x, freedom, slope=0.3, off=0.0):
    """Values on a line, whose u's are estimates from so many degrees of freedom; ``off``: added to each."""
    sigma = np.geomspace(1.0, 1.5, len(x))
    known = np.isinf(freedom)
    u = sigma if known else sigma * np.sqrt(rng.chisquare(freedom, len(x)) / freedom)
    return LinePoints(x, 1000.0 + slope * x + sigma * rng.standard_normal(len(x)) + off, u, np.full(len(x), freedom))


def most(rate):
    """So many of the draws at most, with a chance of 3e-5 that a true rate is called false."""
    return rate + 4.0 * np.sqrt(rate * (1.0 - rate) / DRAWS)


@pytest.mark.parametrize("freedom", [4.0, np.inf])
@pytest.mark.parametrize("count", [3, 6])
def test_clean_lines_alarm_at_the_stated_rate(rng, count, freedom):
    x = np.linspace(-20.0, 50.0, count)
    chances = np.array([fit_line(points(rng, x, freedom)).probability for _ in range(DRAWS)])
    for rate in (0.05, 0.01, REJECTION):
        assert np.mean(chances < rate) <= most(rate)
    assert np.mean(chances < 0.05) > 0.03


def test_of_known_uncertainty_it_is_the_chi2_of_weighted_least_squares(rng):
    x = np.linspace(-20.0, 50.0, 7)
    made = points(rng, x, np.inf)
    slope, at = np.polyfit(x, made.y, 1, w=1.0 / made.u)
    line = fit_line(made)
    assert line.coefficients == pytest.approx([at, slope], rel=1e-12)
    squares = np.sum(((made.y - at - slope * x) / made.u) ** 2)
    assert (line.chi2, line.ratio) == pytest.approx((squares, squares / 5), rel=1e-9)
    assert line.probability == pytest.approx(chi2.sf(squares, 5), rel=1e-9)
    _, covariance = np.polyfit(x, made.y, 1, w=1.0 / made.u, cov="unscaled")
    assert line.uncertainty(np.array([0.0, 1.0]))[0] == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-9)


@pytest.mark.parametrize(("freedom", "least"), [(4.0, 0.915), (30.0, 0.935), (np.inf, 0.935)])
def test_the_interval_of_the_slope_covers_it(rng, freedom, least):
    """95 %, less or more three standard deviations of so many draws; with u's from four degrees of freedom nearly."""
    inside = 0
    for _ in range(DRAWS):
        line = fit_line(points(rng, np.linspace(-20.0, 50.0, 4), freedom))
        u, degrees = line.uncertainty(np.array([0.0, 1.0]))
        inside += abs(line.coefficients[1] - 0.3) <= coverage_factor(degrees) * u
    assert least <= inside / DRAWS <= 0.965


@pytest.mark.parametrize("count", [4, 6, 12])
@pytest.mark.parametrize("place", [0, 2, -1])
@pytest.mark.parametrize("size", [30.0, 3e4])
@pytest.mark.quick("30.0-0-4", "30000.0-2-4", "30.0--1-6", "30000.0-0-6", "30.0-2-12", "30000.0--1-12")
def test_one_outlier_is_named_and_covered(rng, count, place, size):
    """Wherever it lies, whatever it is: Birge's ratio with n - 2 degrees of freedom covers the slope.

    Of four values of which one is 30 u off, another may explain it as well; then both are named.
    """
    x, inside, named = np.linspace(-20.0, 50.0, count), 0, 0
    off = np.zeros(count)
    off[place] = size * rng.choice([-1.0, 1.0])
    for _ in range(200):
        made = points(rng, x, np.inf, off=off)
        line = fit_line(made)
        assert line.probability < REJECTION
        found = explanations(made, REJECTION)
        named += place % count in found and (count == 4 or size == 30.0 or len(found) == 1)
        u = line.uncertainty(np.array([0.0, 1.0]))[0] * np.sqrt(line.ratio)
        inside += abs(line.coefficients[1] - 0.3) <= coverage_factor(line.degrees) * u
    assert inside >= 190
    assert named >= 190


def test_a_parabola_is_told_from_an_outlier(rng):
    x = np.linspace(-20.0, 50.0, 6)
    made = points(rng, x, np.inf, off=0.1 * x**2)
    assert fit_line(made).probability < REJECTION
    assert explanations(made, REJECTION) == [None]
    wild = points(rng, x, np.inf, off=np.array([0.0, 900.0, 0.0, 0.0, -700.0, 0.0]))
    assert explanations(wild, REJECTION) == []
    three = points(rng, x[:3], np.inf, off=np.array([0.0, 900.0, 0.0]))
    assert explanations(three, REJECTION) == []  # nothing would be left to test by


@pytest.mark.parametrize("mountings", [["a"] * 6, list("aaabbbccc"), list("abcde")], ids=["runs", "both", "single"])
def test_clean_runs_alarm_at_the_stated_rate(rng, mountings):
    names = sorted(set(mountings))
    remounting = 2.0 * rng.standard_normal((DRAWS, len(names), 3)) * (len(names) > 1)
    values = rng.standard_normal((DRAWS, len(mountings), 3)) + remounting[:, [names.index(m) for m in mountings]]
    chances = np.array([find_outlier(each, mountings, np.zeros(3)).probability for each in values])
    for rate in (0.05, REJECTION):
        assert np.mean(chances < rate) <= most(rate)
    assert np.mean(chances < 0.05) > 0.02


def test_the_run_or_mounting_outside_the_others_is_the_one_named(rng):
    mountings = list("aaabbbcccddd")
    values = rng.standard_normal((12, 3)) + np.repeat(2.0 * rng.standard_normal((4, 3)), 3, axis=0)
    run, mounting = values.copy(), values.copy()
    run[7, 1] += 60.0
    mounting[3:6, 2] += 9000.0
    found = find_outlier(run, mountings, np.zeros(3))
    assert (np.flatnonzero(found.runs).tolist(), found.parameter) == ([7], 1)
    assert found.probability < REJECTION
    found = find_outlier(mounting, mountings, np.zeros(3))
    assert (np.flatnonzero(found.runs).tolist(), found.parameter) == ([3, 4, 5], 2)
    assert found.probability < REJECTION


def test_too_few_runs_or_runs_alike_tell_nothing(rng):
    assert find_outlier(rng.standard_normal((2, 3)), ["a", "a"], np.zeros(3)) is None
    assert find_outlier(np.ones((5, 3)), ["a"] * 5, np.zeros(3)).probability == 1.0
    alike = np.ones((5, 1)) + 1e-6 * np.eye(5)[:, :1]
    assert find_outlier(alike, ["a"] * 5, np.full(1, 1e-10)).probability == 1.0  # within its own noise

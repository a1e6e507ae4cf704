"""Test whether the deviations from the model look like noise, and say so in words.

The deviations are in units of their stated standard uncertainty, in the order of frequency. A test
fails below a probability of 1 %. The verdict on the model is the result's own; these show where a
misfit comes from.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.result import Result
from vibrident.show.curves import bars_of_deviation, column, principal
from vibrident.show.numbers import NONE, plain, signed
from vibrident.show.views import K, Table, columns

SIGNIFICANCE_LEVEL = 0.01  # probability below which a test fails
#: One test: its name, the value found, the value expected of noise, whether it passes, and what a
#: failure means.
_Outcome = tuple[str, str, str, bool, str]
MIN_POINTS = 8  # fewer points tell nothing of a pattern


def residual_tests(result: Result) -> Table:
    """Test the residuals of the magnitude and, where there is one, of the phase."""
    read = partial(column, result.measured)
    halves = bars_of_deviation(result.measured)
    noise = 100.0 * read("magnitude_noise") / read("magnitude"), read("phase_deg_noise")
    combined = read("deviation_uncertainty_percent"), read("deviation_phase_uncertainty_deg")
    off = read("deviation_percent"), principal(read("deviation_phase_deg"))
    tests = [_chi_squared(result)]
    for i, name in enumerate(("magnitude", "phase")):
        tests += _pattern_tests(
            name, _ordered(result, off[i], halves[i] / K), _in_common(combined[i], noise[i])
        )
    rows = [
        (*words, "passed" if passed else "failed", meaning) for *words, passed, meaning in tests
    ]
    note = (
        "Deviations in units of their standard uncertainty, in the order of frequency; fewer than "
        f"{MIN_POINTS} points with an uncertainty are not tested. Noise alone fails each in "
        f"{100 * SIGNIFICANCE_LEVEL:g} % of cases."
    )
    return Table(
        columns("test", "found", "usual", "outcome", "what a failure means"),
        tuple(rows),
        notes=(note,),
    )


def _in_common(combined: FloatArray, noise: FloatArray) -> bool:
    """Return whether stated systematic effects, which make a pattern, are as large as the noise."""
    ratio = combined / noise
    return bool(np.isfinite(ratio).any() and np.nanmedian(ratio) > math.sqrt(2.0))


def _chi_squared(result: Result) -> _Outcome:
    chi2 = result.fit.chi2_reduced
    freedom = result.fit.degrees_of_freedom
    usual = "about 1"
    if chi2 is not None and freedom > 0:
        from scipy.special import chdtri

        low, high = (float(chdtri(freedom, p)) / freedom for p in (0.975, 0.025))
        usual = f"{low:.2f} to {high:.2f}"
    statistic = NONE if chi2 is None else f"{plain(chi2, 4)} (ν = {freedom})"
    meaning = "the model leaves more than the uncertainties explain; the verdict on the model"
    return "χ²/ν of all points", statistic, usual, result.fit.adequate, meaning


def _ordered(result: Result, deviation: FloatArray, u: FloatArray) -> FloatArray:
    usable = np.isfinite(deviation) & np.isfinite(u) & (u > 0)
    order = np.argsort(result.measured.frequency_hz[usable], kind="stable")
    return (deviation[usable] / u[usable])[order]


def _pattern_tests(name: str, z: FloatArray, common: bool) -> list[_Outcome]:
    if z.size < MIN_POINTS:
        return []
    from scipy.special import bdtr, ndtri

    n = z.size
    inside = int(np.sum(np.abs(z) <= K))
    coverage = math.erf(K / math.sqrt(2.0))
    far = float(ndtri(1.0 - SIGNIFICANCE_LEVEL / (2.0 * n)))
    largest = float(np.max(np.abs(z)))
    lagged = float(np.sum(z[1:] * z[:-1]) / np.sum(z**2)) if np.any(z) else 0.0
    limit = float(ndtri(1.0 - SIGNIFICANCE_LEVEL / 2.0)) / math.sqrt(n)
    enough = float(bdtr(inside, n, coverage)) >= SIGNIFICANCE_LEVEL
    near = f"{100 * coverage:.1f} % of them"
    outlier = "one point is an outlier"
    small = "uncertainties of the points too small, or a misfit at some of them"
    sizes: list[_Outcome] = [
        (f"{name}: points within U", f"{inside} of {n}", near, enough, small),
        (
            f"{name}: largest deviation",
            f"{largest:.2f} u",
            f"below {far:.2f} u",
            largest <= far,
            outlier,
        ),
    ]
    if common:  # these effects make a pattern along frequency
        return sizes
    smooth = "the deviation varies smoothly with frequency: something is missing in the model"
    within = f"within ±{limit:.2f}"
    correlated = (
        f"{name}: correlation of neighbours",
        signed(lagged, 2),
        within,
        abs(lagged) <= limit,
        smooth,
    )
    return [*sizes, _runs(name, z), correlated]


def _runs(name: str, z: FloatArray) -> _Outcome:
    """Apply the Wald-Wolfowitz test to the signs: too few changes of sign are a trend."""
    above = z > 0
    n_above = int(above.sum())
    n_below = int((~above).sum())
    runs = 1 + int(np.sum(above[1:] != above[:-1]))
    n = n_above + n_below
    mean = 1.0 + 2.0 * n_above * n_below / n
    variance = (mean - 1.0) * (mean - 2.0) / (n - 1.0)
    meaning = "long stretches above or below zero: a trend with frequency"
    if variance <= 0:
        return f"{name}: runs of one sign", str(runs), "more than one", False, meaning
    fewest = mean - 2.326 * math.sqrt(variance)  # one-sided, 1 %
    return (
        f"{name}: runs of one sign",
        str(runs),
        f"{fewest:.0f} or more",
        runs >= math.floor(fewest),
        meaning,
    )

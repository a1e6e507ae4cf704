"""Do the deviations from the model look like noise? A few tests of the measured points, said in words.

The deviations are in units of their stated standard uncertainty, in the order of frequency. A test fails below a
probability of 1 %. The verdict on the model is the result's own; these show where a misfit comes from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibrident.plots.deviation import fitted
from vibrident.plots.style import numbers
from vibrident.records import FloatArray
from vibrident.report.numbers import COVERAGE_FACTOR, NONE, plain
from vibrident.report.tables import Table
from vibrident.result import Result

#: Probability below which a test fails.
LEVEL = 0.01
#: Fewer points tell nothing of a pattern.
FEWEST = 8


@dataclass(frozen=True)
class Outcome:
    """One test: what was found, what noise would give, and whether it passes (None: not a test of its own)."""

    name: str
    found: str
    usual: str
    passed: bool | None
    meaning: str


def residual_tests(result: Result) -> Table:
    """Every test of the magnitude and, where there is one, of the phase."""
    outcomes = [_chi_squared(result), *_pattern_tests("magnitude", _magnitude(result))]
    outcomes += _pattern_tests("phase", _phase(result))
    verdicts = {True: "passed", False: "failed", None: NONE}
    rows = tuple((o.name, o.found, o.usual, verdicts[o.passed], o.meaning) for o in outcomes)
    note = (
        "Deviations in units of their standard uncertainty, in the order of frequency; fewer than "
        f"{FEWEST} points with an uncertainty are not tested. Noise alone fails each in {100 * LEVEL:g} % of cases."
    )
    return Table(("test", "found", "usual", "outcome", "what a failure means"), rows, (), notes=(note,))


def _chi_squared(result: Result) -> Outcome:
    chi2, freedom = result.fit.chi2_reduced, result.fit.degrees_of_freedom
    usual = "about 1"
    if chi2 is not None and freedom > 0:
        from scipy.special import chdtri

        low, high = (float(chdtri(freedom, p)) / freedom for p in (0.975, 0.025))
        usual = f"{low:.2f} to {high:.2f}"
    found = NONE if chi2 is None else f"{plain(chi2, 4)} (ν = {freedom})"
    meaning = "the model leaves more than the uncertainties explain; the verdict on the model"
    return Outcome("χ²/ν of all points", found, usual, result.fit.adequate, meaning)


def _magnitude(result: Result) -> FloatArray:
    measured = result.measured
    magnitude = numbers(measured.magnitude)
    relative = 100.0 * fitted(numbers(measured.magnitude_uncertainty), magnitude) / magnitude
    return _ordered(result, fitted(numbers(measured.deviation_percent), magnitude), relative)


def _phase(result: Result) -> FloatArray:
    measured = result.measured
    like = numbers(measured.magnitude)
    turned = (fitted(numbers(measured.deviation_phase_deg), like) + 180.0) % 360.0 - 180.0
    return _ordered(result, turned, fitted(numbers(measured.phase_deg_uncertainty), like))


def _ordered(result: Result, deviation: FloatArray, u: FloatArray) -> FloatArray:
    usable = np.isfinite(deviation) & np.isfinite(u) & (u > 0)
    order = np.argsort(numbers(result.measured.frequency_hz)[usable], kind="stable")
    return (deviation[usable] / u[usable])[order]


def _pattern_tests(name: str, z: FloatArray) -> list[Outcome]:
    if z.size < FEWEST:
        return []
    from scipy.special import bdtr, ndtri

    n = z.size
    inside = int(np.sum(np.abs(z) <= COVERAGE_FACTOR))
    coverage = math.erf(COVERAGE_FACTOR / math.sqrt(2.0))
    far = float(ndtri(1.0 - LEVEL / (2.0 * n)))
    largest = float(np.max(np.abs(z)))
    lagged = float(np.sum(z[1:] * z[:-1]) / np.sum(z**2)) if np.any(z) else 0.0
    limit = float(ndtri(1.0 - LEVEL / 2.0)) / math.sqrt(n)
    return [
        Outcome(
            f"{name}: points within U",
            f"{inside} of {n}",
            f"{100 * coverage:.1f} % of them",
            float(bdtr(inside, n, coverage)) >= LEVEL,
            "uncertainties of the points too small, or a misfit at some of them",
        ),
        Outcome(
            f"{name}: largest deviation",
            f"{largest:.2f} u",
            f"below {far:.2f} u",
            largest <= far,
            "one point is an outlier",
        ),
        _runs(name, z),
        Outcome(
            f"{name}: correlation of neighbours",
            f"{lagged:+.2f}",
            f"within ±{limit:.2f}",
            abs(lagged) <= limit,
            "the deviation varies smoothly with frequency: something is missing in the model",
        ),
    ]


def _runs(name: str, z: FloatArray) -> Outcome:
    """Wald-Wolfowitz test on the signs: too few changes of sign are a trend."""
    above = z > 0
    n_above, n_below = int(above.sum()), int((~above).sum())
    runs = 1 + int(np.sum(above[1:] != above[:-1]))
    n = n_above + n_below
    mean = 1.0 + 2.0 * n_above * n_below / n
    variance = (mean - 1.0) * (mean - 2.0) / (n - 1.0)
    meaning = "long stretches above or below zero: a trend with frequency"
    if variance <= 0:
        return Outcome(f"{name}: runs of one sign", str(runs), "more than one", False, meaning)
    fewest = mean - 2.326 * math.sqrt(variance)  # one-sided, 1 %
    return Outcome(f"{name}: runs of one sign", str(runs), f"{fewest:.0f} or more", runs >= math.floor(fewest), meaning)

"""When deviations are larger than their noise explains: the test that all verdicts share."""

from __future__ import annotations

import numpy as np

from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray

#: A model is rejected below this probability.
REJECTION = 1e-3


def as_chi2(squares: FloatArray, freedom: FloatArray) -> FloatArray:
    """χ² of two degrees of freedom, as improbable as squares of two parts over variances that are estimates.

    Half of such a square q is F-distributed with 2 and ν degrees of freedom, so chance makes it larger with the
    probability (1 + q/ν)^(−ν/2) (Fisher's combination of probabilities; Fisher 1932).

    Args:
        squares: q, shape (n,).
        freedom: ν behind each variance, shape (n,).
    """
    return freedom * np.log1p(squares / freedom)


def shrunk(freedom: FloatArray) -> FloatArray:
    """1 − 2/ν: by so much squares over a variance of ν degrees of freedom are too large in the mean, shape (n,)."""
    return np.maximum(1.0 - 2.0 / freedom, 0.1)


def probability(chi2: float, degrees: int) -> float:
    """Chance of a χ² at least this large when the model is right."""
    return chi2_tail(degrees, chi2) if degrees > 0 else 1.0


def chance_of(points: FloatArray, degrees: int, beside: float = 0.0) -> float:
    """Chance of points at least as far from a right model, by their sum or by the furthest of them (Bonferroni).

    The sum of many points hides one that is far off, as at a resonance that the model lacks.

    Args:
        points: χ² of two degrees of freedom each, shape (n,).
        degrees: of freedom of all, less the parameters that were fitted.
        beside: χ² of what else is judged with them.
    """
    if degrees <= 0:
        return 1.0
    furthest = len(points) * float(np.exp(-0.5 * np.max(points)))
    return min(1.0, 2.0 * min(probability(float(np.sum(points)) + beside, degrees), furthest))

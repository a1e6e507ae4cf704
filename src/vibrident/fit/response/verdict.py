"""Test of deviations against their noise, which all verdicts share."""

from __future__ import annotations

import numpy as np

from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray

#: A model is rejected below this probability.
REJECTION = 1e-3


def as_chi2(squares: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return χ² of two degrees of freedom, as improbable as squares over estimated variances.

    Half of such a square q of two parts is F-distributed with 2 and ν degrees of freedom, so chance
    makes it larger with the probability (1 + q/ν)^(−ν/2) (Fisher 1932).

    Args:
        squares: q, shape (n,).
        freedom: ν of each variance, shape (n,).
    """
    return freedom * np.log1p(squares / freedom)


def shrunk(freedom: FloatArray) -> FloatArray:
    """Return 1 − 2/ν, shape (n,).

    The mean of squares over a variance of ν degrees of freedom is too large by the inverse of this.
    """
    return np.maximum(1.0 - 2.0 / freedom, 0.1)


def probability(chi2: float, degrees: int) -> float:
    """Return the chance of a χ² at least this large when the model is right."""
    return chi2_tail(degrees, chi2) if degrees > 0 else 1.0


def chance_of(points: FloatArray, degrees: int, other_chi2: float = 0.0) -> float:
    """Return the chance of points at least as far from a right model, by their sum or the furthest.

    The sum of many points hides one that is far off, as at a resonance that the model lacks; the
    furthest is judged by Bonferroni's bound.

    Args:
        points: χ² of two degrees of freedom each, shape (n,).
        degrees: of freedom of all, less the parameters that were fitted.
        other_chi2: χ² of other quantities that are judged together with the points.
    """
    if degrees <= 0:
        return 1.0
    furthest = len(points) * float(np.exp(-0.5 * np.max(points)))
    total = probability(float(np.sum(points)) + other_chi2, degrees)
    return min(1.0, 2.0 * min(total, furthest))


def only_one_is_far(points: FloatArray, degrees: int, other_chi2: float = 0.0) -> bool:
    """Return whether a model is rejected by the furthest point alone; arguments as of chance_of."""
    total = probability(float(np.sum(points)) + other_chi2, degrees)
    return 2.0 * total >= REJECTION > chance_of(points, degrees, other_chi2)

"""When deviations are larger than their noise explains: the χ² test that all verdicts share."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray

#: A model is rejected below this probability.
REJECTION = 1e-3


def likelihood_ratio(squares: Any, freedom: Any, parts: Any = 2) -> FloatArray:
    """Sums of squares over variances that are estimates, as the χ² that each would be were its variance known.

    A sum over its parts' number is an F. (ν + k/2 − 1) log(1 + x/ν) is a χ² of k degrees of freedom: for two parts
    exactly, as the chance of a larger x is (1 + x/ν)^(−ν/2); else with Bartlett's correction (Wilks 1938).

    Args:
        squares: x, each the sum of the squares of some parts over one variance.
        freedom: ν, degrees of freedom behind each variance; infinite where it is known.
        parts: k, the number of parts of each.
    """
    x, known, k = np.broadcast_arrays(*(np.asarray(each, dtype=float) for each in (squares, freedom, parts)))
    finite = np.where(np.isfinite(known), known, 1.0)
    return np.where(np.isfinite(known), (finite + 0.5 * k - 1.0) * np.log1p(x / finite), x)


def probability(chi2: float, degrees: int) -> float:
    """Chance of a χ² at least this large when the model is right; one without degrees of freedom."""
    return chi2_tail(degrees, chi2) if degrees > 0 else 1.0


def rejected(chi2: float, degrees: int) -> bool:
    """Whether the model is rejected."""
    return probability(chi2, degrees) < REJECTION

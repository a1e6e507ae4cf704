"""When deviations are larger than their noise explains: the χ² test that all verdicts share."""

from __future__ import annotations

import numpy as np

from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray

#: A model is rejected below this probability.
REJECTION = 1e-3
#: Least degrees of freedom of a variance: with fewer its spread is undefined.
LEAST_FREEDOM = 6.0


def probability(chi2: float, degrees: int, freedom: FloatArray | None = None) -> float:
    """Chance of a χ² at least this large when the model is right.

    Args:
        chi2: sum of squared deviations over their variance.
        degrees: degrees of freedom.
        freedom: degrees of freedom behind each variance, where variances are estimates. With the mean brought back by
            1 − 2/ν, each square of two parts then has ν/(ν − 4) times the variance of a χ² (it is an F's), and the sum
            is compared with the multiple of a χ² that has its mean and variance (Satterthwaite 1946).
    """
    if degrees <= 0:
        return 1.0
    spread = 1.0
    if freedom is not None:
        known = np.maximum(freedom, LEAST_FREEDOM)
        spread = float(np.mean(known / (known - 4.0)))
    return chi2_tail(degrees / spread, chi2 / spread)


def rejected(chi2: float, degrees: int, freedom: FloatArray | None = None) -> bool:
    """Whether the model is rejected; arguments as :func:`probability`."""
    return probability(chi2, degrees, freedom) < REJECTION

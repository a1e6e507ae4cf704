"""When deviations are larger than their noise explains: the χ² test that all verdicts share."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc

from vibrident.records import FloatArray

#: A model is rejected below this probability.
REJECTION = 1e-3


def probability(chi2: float, degrees: int, freedom: FloatArray | None = None) -> float:
    """Chance of a χ² at least this large when the model is right.

    Args:
        chi2: sum of squared deviations over their variance.
        degrees: degrees of freedom.
        freedom: degrees of freedom behind each variance, where variances are estimates; they widen χ² by 1 + 4/ν.
    """
    if degrees <= 0:
        return 1.0
    spread = 1.0 if freedom is None else 1.0 + 4.0 / float(np.mean(freedom))
    return float(chdtrc(degrees, chi2 / spread))


def rejected(chi2: float, degrees: int, freedom: FloatArray | None = None) -> bool:
    """Whether the model is rejected; arguments as :func:`probability`."""
    return probability(chi2, degrees, freedom) < REJECTION

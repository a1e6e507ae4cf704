"""What U = k u covers: the coverage probability that belongs to k and the effective degrees of freedom (GUM G.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vibrident.report.numbers import COVERAGE_FACTOR, plain
from vibrident.result import Result

_KEY = "effective_degrees_of_freedom"


@dataclass(frozen=True)
class Coverage:
    """Coverage of an expanded uncertainty.

    Attributes:
        factor: k.
        degrees_of_freedom: effective ones; infinite where the distribution is normal, None where not stated.
        probability: of the interval value ± U.
    """

    factor: float
    degrees_of_freedom: float | None
    probability: float

    @property
    def text(self) -> str:
        """All of it in a sentence."""
        percent = f"{100 * self.probability:.1f} %"
        if self.degrees_of_freedom is None:
            return f"k = {self.factor:g}: coverage probability {percent} for a normal distribution."
        if math.isinf(self.degrees_of_freedom):
            return f"k = {self.factor:g}: coverage probability {percent} (normal distribution, ν_eff = ∞)."
        freedom = plain(self.degrees_of_freedom, 3)
        return f"k = {self.factor:g}: coverage probability {percent} (Student's t with ν_eff = {freedom})."


def coverage(result: Result) -> Coverage:
    """Coverage of every U of a result."""
    k = COVERAGE_FACTOR
    if _KEY not in result.settings:
        return Coverage(k, None, math.erf(k / math.sqrt(2.0)))
    freedom = result.settings[_KEY]
    if freedom is None or not math.isfinite(freedom) or freedom > 1e6:  # JSON has no infinity: it is written as null
        return Coverage(k, math.inf, math.erf(k / math.sqrt(2.0)))
    from scipy.special import stdtr

    return Coverage(k, float(freedom), float(2.0 * stdtr(freedom, k) - 1.0))

"""A mixture of normal distributions: the distribution of a value when its variance is uncertain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from vibrident.records import FloatArray

#: Bisections of the interval that holds a quantile: they resolve 10⁻¹² of it.
_HALVINGS = 45


@dataclass(frozen=True, eq=False)
class Mixture:
    """Normal distributions with weights.

    Attributes:
        weight: shape (m,), their sum is one.
        mean: shape (m,).
        deviation: standard deviations, all above zero, shape (m,).
    """

    weight: FloatArray
    mean: FloatArray
    deviation: FloatArray

    def below(self, value: float) -> float:
        """Probability of a value below ``value``."""
        return float(self.weight @ ndtr((value - self.mean) / self.deviation))

    def quantile(self, probability: float) -> float:
        """The value that is exceeded with 1 − ``probability``."""
        weighty = self.weight > 1e-12
        reach = 40.0 * self.deviation[weighty]
        low, high = float(np.min(self.mean[weighty] - reach)), float(np.max(self.mean[weighty] + reach))
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if self.below(middle) < probability else (low, middle)
        return (low + high) / 2

    @property
    def interval_95(self) -> tuple[float, float]:
        """The probabilistically symmetric 95 % coverage interval."""
        return self.quantile(0.025), self.quantile(0.975)

    @property
    def value(self) -> float:
        """The median: with few data the tails are so long that they have no mean."""
        return self.quantile(0.5)

    @property
    def u(self) -> float:
        """Standard uncertainty: a quarter of the 95 % interval, so that U = 2 u covers 95 % even with long tails."""
        low, high = self.interval_95
        return (high - low) / 4

"""A channel of a record as the screening looks at it: its valid samples, sorted once."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.screening.steps import RELATIVE_EQUALITY


@dataclass(frozen=True, eq=False)
class ChannelSamples:
    """A channel's samples, and which of them to look at.

    Attributes:
        values: shape (samples,).
        valid: samples to look at, shape (samples,).
    """

    values: FloatArray
    valid: BoolArray

    @functools.cached_property
    def all_valid(self) -> bool:
        """Return whether every sample is valid."""
        return bool(self.valid.all())

    @functools.cached_property
    def ordered(self) -> FloatArray:
        """Return the valid values in rising order, shape (valid samples,)."""
        return np.sort(self.values if self.all_valid else self.values[self.valid])

    @property
    def upside_down(self) -> ChannelSamples:
        """Return the channel with all signs changed."""
        inverted = ChannelSamples(-self.values, self.valid)
        vars(inverted).update(ordered=-self.ordered[::-1], ties=self.ties)
        return inverted

    @functools.cached_property
    def ties(self) -> int:
        """Return how many of the valid values have an equal among the others before them."""
        gaps = self.ordered[1:] - self.ordered[:-1]
        return int(np.count_nonzero(gaps <= RELATIVE_EQUALITY * self.span))

    @property
    def span(self) -> float:
        """Return the largest valid value less the smallest; zero without any."""
        return float(self.ordered[-1] - self.ordered[0]) if self.ordered.size else 0.0

    @property
    def middle(self) -> float:
        """Return the median of the valid values; zero without any."""
        count = self.ordered.size
        if not count:
            return 0.0
        return float(np.mean(self.ordered[(count - 1) // 2 : count // 2 + 1]))

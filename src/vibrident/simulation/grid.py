"""Equally spaced instants, from any fractional position."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibrident.records import FloatArray

_COINCIDENT = 1e-9  # an instant this close to a sample, in samples, is that sample


@dataclass(frozen=True)
class SampleGrid:
    """``samples`` instants start_s + k/rate_hz."""

    start_s: float
    rate_hz: float
    samples: int

    @property
    def interval_s(self) -> float:
        """Time between instants, s."""
        return 1.0 / self.rate_hz

    @property
    def times_s(self) -> FloatArray:
        """The instants, s, shape (samples,)."""
        return self.start_s + np.arange(self.samples) / self.rate_hz

    def first_from(self, time_s: float) -> int:
        """Index of the first instant at or after ``time_s``, at most ``samples``."""
        index = math.ceil((time_s - self.start_s) * self.rate_hz - _COINCIDENT)
        return min(max(index, 0), self.samples)

    def since(self, time_s: float) -> SampleGrid:
        """The instants at or after ``time_s``, counted from ``time_s``."""
        first = self.first_from(time_s)
        start = self.start_s + first / self.rate_hz - time_s
        return SampleGrid(max(start, 0.0), self.rate_hz, self.samples - first)

"""Records of one length and rate as one array, at the bins of the band.

Bins above the band of the motion say nothing of the sensor, so they are left out before anything
else is computed.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.bins.segments import TONE_COLUMNS, Segment, shifted_lines, tone_bins
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import line_counts

#: Numbers of an array of (records, bins) that is worked on at once: it stays in the cache.
MAX_AT_ONCE = 1 << 15


@dataclass(frozen=True)
class Grid:
    """Bins of a transform, and the step of the network over it.

    Attributes:
        samples: N.
        rate_hz: sampling rate, Hz.
        fraction: place within a step at which the response is read, at the delay of the inputs.
        bins: number of bins K, from 0 on.
        last: bins from here on do not count.
        hum: places of tones that no motion causes, in bins.
    """

    samples: int
    rate_hz: float
    fraction: float
    bins: int
    last: int
    hum: tuple[float, ...] = ()

    @property
    def step(self) -> tuple[float, float]:
        """Sampling interval, s, and fraction."""
        return 1.0 / self.rate_hz, self.fraction

    @functools.cached_property
    def shifted(self) -> ComplexArray:
        """Return w = z − 1 at the bins, shape (K,)."""
        return shifted_lines(self.samples, slice(0, self.bins))

    @functools.cached_property
    def frequency_hz(self) -> FloatArray:
        """Return frequencies, shape (K,); bin 0, which does not count, has that of bin 1."""
        return np.maximum(np.arange(self.bins), 1) * (self.rate_hz / self.samples)

    @functools.cached_property
    def counts(self) -> FloatArray:
        """Return how often each bin counts in a sum over the transform, shape (K,)."""
        counts = line_counts(self.samples)[: self.bins]
        counts[0] = 0.0
        counts[self.last :] = 0.0
        return counts

    @functools.cached_property
    def unmoved(self) -> ComplexArray:
        """Return columns that depend on no parameter, shape (m, K): drift, and tones of hum."""
        shifted = np.where(self.shifted == 0.0, 1.0, self.shifted)
        drift = ((1.0 + self.shifted) / shifted)[None]
        if not self.hum:
            return drift
        tones = tone_bins(self.hum, self.samples, slice(0, self.bins))
        return np.concatenate([drift, tones.reshape(TONE_COLUMNS * len(self.hum), -1)])


@dataclass(frozen=True, eq=False)
class Group:
    """Segments of records on one grid.

    Attributes:
        grid: the bins.
        segments: number of each segment in the problem, shape (R,).
        inputs: transforms of the inputs of the steps, shape (R, q, K).
        response: transforms of the response, zero where it is not used, shape (R, K).
        used: samples of the response that are used, shape (R, N); None: all.
    """

    grid: Grid
    segments: tuple[int, ...]
    inputs: ComplexArray
    response: ComplexArray
    used: BoolArray | None = None

    @classmethod
    def from_segments(cls, grid: Grid, numbers: Sequence[int], segments: Sequence[Segment]) -> Group:
        """Join segments of one length and rate."""
        bins = slice(0, grid.bins)
        inputs = np.stack([segment.inputs[:, bins] for segment in segments])
        response = np.stack([segment.response[bins] for segment in segments])
        used = None
        if any(segment.used is not None for segment in segments):
            everywhere = np.ones(grid.samples, dtype=bool)
            used = np.stack([everywhere if s.used is None else s.used for s in segments])
        return cls(grid, tuple(numbers), inputs, response, used)

    def part(self, rows: slice) -> Group:
        """Return some of the segments."""
        used = None if self.used is None else self.used[rows]
        return replace(
            self,
            segments=self.segments[rows],
            inputs=self.inputs[rows],
            response=self.response[rows],
            used=used,
        )

    @property
    def samples_used(self) -> FloatArray:
        """Return the number of samples that are used, shape (R,)."""
        if self.used is None:
            return np.full(len(self.segments), float(self.grid.samples))
        return np.sum(self.used, axis=1).astype(float)

    def where_used(self, rows: ComplexArray) -> ComplexArray:
        """Set signals to zero where the response is not used; (R, i, K) to the same shape."""
        if self.used is None:
            return rows
        signals = fft.irfft(rows, self.grid.samples, axis=-1)
        return np.asarray(fft.rfft(signals * self.used[:, None], axis=-1))[..., : rows.shape[-1]]


def in_parts(rows: int, bins: int) -> Iterator[slice]:
    """Yield slices of rows that are worked on at once."""
    width = max(MAX_AT_ONCE // max(bins, 1), 1)
    for begin in range(0, rows, width):
        yield slice(begin, min(begin + width, rows))

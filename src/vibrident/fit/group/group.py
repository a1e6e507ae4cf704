"""Records of one sampling rate as one array, at the bins of the band.

Bins above the band of the motion carry no information on the sensor, so they are left out before
anything else is computed.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.bins.segments import Segment, shifted_lines, tone_bins
from vibrident.fit.group.gaps import MAX_FILLED_SAMPLES, RowFilling
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import line_counts

#: Numbers of an array of (records, bins) that are processed at once: they stay in the cache.
MAX_BATCH_SIZE = 1 << 15


def in_batches(rows: int, bins: int) -> Iterator[slice]:
    """Yield slices of rows that are processed at once."""
    width = max(MAX_BATCH_SIZE // max(bins, 1), 1)
    for begin in range(0, rows, width):
        yield slice(begin, min(begin + width, rows))


@dataclass(frozen=True)
class Grid:
    """Bins of the transform of N samples, and the step of the network over them.

    Attributes:
        samples: N.
        rate_hz: sampling rate, Hz.
        fraction: place within a step at which the response is read, at the delay of the inputs.
        bins: number of bins K, from 0 on.
        last: bins from here on do not count.
        first: bins before this one do not count, but for an offset.
        aliased: whether the free motion is above half the sampling rate.
        tones: places of tones that no motion causes, in bins.
        edges: whether the slopes of the initial states over the record are nuisances, too: where
            the noise is steep, leakage at the ends of a record would count as information.
        has_gaps: whether samples of the response are left out.
        driven: whether there is a reference; a free decay has none.
        full_band: whether every bin counts that counts in time, and no drift is a nuisance.
    """

    samples: int
    rate_hz: float
    fraction: float
    bins: int
    last: int
    tones: tuple[float, ...] = ()
    edges: bool = False
    has_gaps: bool = False
    driven: bool = True
    full_band: bool = False
    first: int = 1
    aliased: bool = False

    @property
    def step(self) -> tuple[float, float]:
        """Return the sampling interval, s, and the fraction."""
        return 1.0 / self.rate_hz, self.fraction

    @functools.cached_property
    def shifted(self) -> ComplexArray:
        """Return W = z − 1 at the bins, shape (K,)."""
        return shifted_lines(self.samples, slice(0, self.bins))

    @functools.cached_property
    def frequency_hz(self) -> FloatArray:
        """Return the frequencies, shape (K,); bin 0, which does not count, has that of bin 1."""
        return np.maximum(np.arange(self.bins), 1) * (self.rate_hz / self.samples)

    @functools.cached_property
    def counts(self) -> FloatArray:
        """Return how often each bin counts in a mean over the samples, shape (K,)."""
        counts = line_counts(self.samples)[: self.bins] / self.samples
        counts[1 : self.first] = 0.0
        if self.first > 1 or not (self.full_band and self.has_gaps):  # an offset is at bin 0 alone
            counts[0] = 0.0
        counts[self.last :] = 0.0
        return counts

    def resampled(self, values: FloatArray, samples: int) -> FloatArray:
        """Return values at the bins of so many samples at the bins of this grid, shape (K,)."""
        if samples == self.samples and len(values) >= self.bins:
            return values[: self.bins]
        places = np.arange(self.bins) * (samples / self.samples)
        return np.interp(places, np.arange(len(values)), values)

    @functools.cached_property
    def fixed_nuisances(self) -> ComplexArray:
        """Return the columns that depend on no parameter, drift and tones of hum, shape (m, K)."""
        nonzero = np.where(self.shifted == 0.0, 1.0, self.shifted)
        drift = ((1.0 + self.shifted) / nonzero)[None]
        columns = [drift[: 0 if self.full_band else 1]]
        if self.edges:
            columns.append(drift / nonzero)
        if self.has_gaps:  # an offset is not at bin 0 alone
            columns.append((np.arange(self.bins) == 0)[None] * complex(self.samples))
        if self.tones:
            columns.append(tone_bins(self.tones, self.samples, slice(0, self.bins)))
        return np.concatenate(columns)


@dataclass(frozen=True, eq=False)
class Bins:
    """Rows of R segments at K bins each, at which the network can be evaluated.

    Attributes:
        step: sampling interval, s, and place within a step at which the response is read.
        inputs: transforms of the inputs of the steps, shape (R, q, K).
        response: transforms of the response, zero where it is not used, shape (R, K).
        shifted: w = z − 1, shape (R, K), or (1, K) where all have the same.
        fixed_nuisances: nuisance columns that depend on no parameter, shape (R or 1, m, K).
        edges: as of :class:`Grid`.
        aliased: as of :class:`Grid`.
        used: samples of the response that are used, shape (R, N); None: all.
    """

    step: tuple[float, float]
    inputs: ComplexArray
    response: ComplexArray
    shifted: ComplexArray
    fixed_nuisances: ComplexArray
    edges: bool = False
    aliased: bool = False
    used: BoolArray | None = None

    def observer(self, weight: FloatArray) -> Callable[[ComplexArray], ComplexArray]:
        """Return the function from signals to what the response shows of them, shapes (R, i, K).

        Values where the response is not used are least squares in a weight of the bins, shape (R or
        1, K), or zero where there are many.
        """
        if self.used is None:
            return lambda rows: rows
        if np.max(np.sum(~self.used, axis=1)) > MAX_FILLED_SAMPLES:
            return self.where_used
        weights = np.broadcast_to(weight, (len(self.used), weight.shape[1]))
        fillings = [
            None if used.all() else RowFilling.in_weight(used, weight_of_row)
            for used, weight_of_row in zip(self.used, weights, strict=True)
        ]

        def filled(rows: ComplexArray) -> ComplexArray:
            of_segments = np.broadcast_to(rows, (len(fillings), *rows.shape[1:]))
            return np.stack(
                [
                    row if filling is None else filling(row)
                    for row, filling in zip(of_segments, fillings, strict=True)
                ]
            )

        return filled

    def where_used(self, rows: ComplexArray) -> ComplexArray:
        """Return signals set to zero where the response is not used, shape (R, i, K)."""
        if self.used is None:
            return rows
        signals = fft.irfft(rows, self.used.shape[1], axis=-1)
        return np.asarray(fft.rfft(signals * self.used[:, None], axis=-1))


@dataclass(frozen=True, eq=False)
class Group(Bins):
    """Segments of one length and rate.

    Attributes:
        grid: their bins.
        segments: number of each segment in the problem, shape (R,).
    """

    grid: Grid = Grid(0, 1.0, 0.0, 0, 0)
    segments: tuple[int, ...] = ()

    @classmethod
    def from_segments(
        cls, grid: Grid, numbers: Sequence[int], segments: Sequence[Segment]
    ) -> Group:
        """Return segments of one length and rate as a group."""
        bins = slice(0, grid.bins)
        inputs = np.stack([segment.inputs[:, bins] for segment in segments])
        response = np.stack([segment.response[bins] for segment in segments])
        used = None
        if any(segment.used is not None for segment in segments):
            all_used = np.ones(grid.samples, dtype=bool)
            used = np.stack([all_used if s.used is None else s.used for s in segments])
        columns = grid.shifted[None], grid.fixed_nuisances[None]
        flags = grid.edges, grid.aliased
        return cls(grid.step, inputs, response, *columns, *flags, used, grid, tuple(numbers))

    @property
    def count(self) -> FloatArray:
        """Return the number of samples that are used, shape (R,)."""
        if self.used is None:
            return np.full(len(self.segments), float(self.grid.samples))
        return np.sum(self.used, axis=1).astype(float)

    def at(self, row: int, bins: NDArray[np.int_]) -> Bins:
        """Return one segment at some bins, shape (b,), as if all of its samples were used."""
        return Bins(
            self.step,
            self.inputs[row : row + 1, :, bins],
            self.response[row : row + 1, bins],
            self.shifted[:, bins],
            self.fixed_nuisances[:, :, bins],
            self.edges,
            self.aliased,
        )

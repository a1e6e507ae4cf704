"""Levels of exponentially distributed powers along the bins of arrays (records, bins)."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.response.response import ComplexArray

#: Most bins in which shapes of a spectrum are compared, evenly spread over log frequency.
MAX_LOG_BINS = 160
#: Bins on either side that a level is averaged over: so many times the root of their number …
AVERAGED_ROOTS = 0.9
#: … and at least so many …
MIN_AVERAGED_BINS = 24
#: … except the nearest, which belong to a tone, too.
NEAREST_BINS = 2
#: Lower limit of powers, whose logarithm must be finite.
MIN_POWER = 1e-300


def averaged_bins(bins: int) -> int:
    """Return the number of bins on either side that a level is averaged over."""
    return max(int(AVERAGED_ROOTS * bins**0.5), MIN_AVERAGED_BINS)


def mean_around(
    rows: FloatArray, width: int | NDArray[np.int_], nearest: int = NEAREST_BINS
) -> FloatArray:
    """Return the mean over ``width`` bins on either side except the nearest, mirrored at the ends.

    Args:
        rows: shape (R, K); of fewer bins than are left out, the mean of all is returned.
        width: bins on either side, of all or of each bin.
        nearest: bins on either side that are left out, and the bin itself.
    """
    records, bins = rows.shape
    width = np.minimum(width, bins - 2)
    max_width = int(np.max(width))
    if max_width <= nearest:
        return np.broadcast_to(np.mean(rows, axis=1, keepdims=True), rows.shape)
    sums = np.empty((records, bins + 2 * max_width + 1))
    sums[:, 0] = 0.0
    sums[:, 1 : max_width + 1] = rows[:, max_width:0:-1]
    sums[:, max_width + 1 : -max_width] = rows
    sums[:, -max_width:] = rows[:, -2 : -max_width - 2 : -1]
    np.cumsum(sums, axis=1, out=sums)
    if width.ndim:
        place = np.arange(bins) + max_width
        within = sums[:, place + width + 1]
        within -= sums[:, place - width]
    else:
        within = sums[:, 2 * max_width + 1 :] - sums[:, :bins]
    within -= sums[:, max_width + nearest + 1 : max_width + nearest + 1 + bins]
    within += sums[:, max_width - nearest : max_width - nearest + bins]
    within /= 2.0 * (width - nearest)
    return within


def log_power(power: FloatArray) -> FloatArray:
    """Return the logarithm of a power, shape (R, K).

    Bin 0, which does not count, gets the value of bin 1.
    """
    logarithm = np.maximum(power, MIN_POWER)
    logarithm[..., 0] = logarithm[..., 1]
    return np.log(logarithm, out=logarithm)


def typical(power: FloatArray, width: int) -> FloatArray:
    """Return the level around each bin from the logarithms, which few strong bins hardly change.

    Args:
        power: exponentially distributed, shape (R, K).
        width: bins on either side.
    """
    return np.exp(mean_around(np.log(np.maximum(power, MIN_POWER)), width) + np.euler_gamma)


def level_around(logarithm: FloatArray, weight: FloatArray | None = None) -> FloatArray:
    """Return the mean logarithm of powers from half to twice the frequency of each bin at most.

    Towards frequency zero noise is steep: there fewer bins are alike.

    Args:
        logarithm: shape (R, K).
        weight: of each bin, shape (R, K); None: all count alike.
    """
    bins = logarithm.shape[-1]
    width = averaged_bins(bins)
    place = np.arange(bins)
    low = place - np.minimum(place // 2, width)
    high = np.minimum(place + np.minimum(place, width), bins - 1) + 1

    def within(rows: FloatArray) -> FloatArray:
        sums = np.zeros((len(rows), bins + 1))
        np.cumsum(rows, axis=1, out=sums[:, 1:])
        level = sums[:, high]
        level -= sums[:, low]
        return level

    if weight is None:
        return within(logarithm) / (high - low)
    return within(logarithm * weight) / within(weight)


def windowed(rows: ComplexArray) -> ComplexArray:
    """Return the bins (R, K − 2) under a Hann window, scaled to the same noise, from bin 1 on."""
    smooth = rows[:, :-2] + rows[:, 2:]
    smooth *= -0.25 / np.sqrt(0.375)
    smooth += rows[:, 1:-1] * (0.5 / np.sqrt(0.375))
    return smooth


class LogBins(NamedTuple):
    """Intervals of bins, evenly spread over the logarithm of frequency.

    Attributes:
        edges: first bins, and the bin after the last, shape (B + 1,).
        order: geometric mean of the numbers of their bins, shape (B,).
    """

    edges: NDArray[np.int_]
    order: FloatArray

    @property
    def counts(self) -> FloatArray:
        """Return the number of bins in each interval, shape (B,)."""
        return np.diff(self.edges).astype(float)

    def sums(self, rows: FloatArray) -> FloatArray:
        """Return the sum over each interval; (R, K) to (R, B)."""
        return np.add.reduceat(rows[..., : self.edges[-1]], self.edges[:-1], axis=-1)

    def geometric_means(self, logarithm: FloatArray) -> FloatArray:
        """Return the geometric means over intervals from logarithms; (R, K) to (R, B)."""
        return np.exp(self.sums(logarithm) / self.counts)


@functools.lru_cache(maxsize=8)
def log_bins(last: int) -> LogBins:
    """Return the intervals of the bins from 1 up to, but without, ``last``."""
    edges = distinct(np.round(np.geomspace(1, last, MAX_LOG_BINS)).astype(int))
    bins = LogBins(edges, np.zeros(0))
    return LogBins(edges, bins.geometric_means(np.log(np.maximum(np.arange(last), 1.0))))


def mean_over_geometric(counts: FloatArray) -> FloatArray:
    """Return the ratio of mean to geometric mean of exponentially distributed powers.

    It is Γ(1 + 1/n)⁻ⁿ for n powers. The geometric mean is used because a tone that is not quite
    fitted, or hum, is not the noise that is estimated.
    """
    counts = np.maximum(counts, 1e-2)
    log_gamma = np.vectorize(math.lgamma, otypes=[float])(1.0 + 1.0 / counts)
    return np.exp(-counts * log_gamma)

"""The level of noise around each bin, relative to a shape that it nearly has.

Far from frequency zero it is the mean over the bins on either side. In the lowest bins noise may be
steep within so many: there a power of frequency is fitted to the bins around a few places by
likelihood (a generalised linear model of exponentially distributed powers with a logarithmic link:
McCullagh & Nelder 1989, ch. 8), and between the places it is interpolated.
"""

from __future__ import annotations

import functools
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.noise.averages import (
    MIN_AVERAGED_BINS,
    MIN_POWER,
    NEAREST_BINS,
    averaged_bins,
    level_around,
    mean_around,
)
from vibrident.fit.response.verdict import REJECTION

#: Powers beyond this many times the level are no noise: one of 22,000 white ones is.
MAX_POWER_RATIO = 10.0
#: Fewest degrees of freedom of a bin whose power counts.
MIN_FREEDOM = 1e-3
#: Bins on either side are at most this fraction of the number of a bin: within them noise is not
#: steep.
MAX_WIDTH_FRACTION = 1 / 4
#: Bins on either side over which a resonance of the noise shows.
RESONANCE_BINS = 8
#: Places at which a power of frequency is fitted.
PLACES = 14
#: Steps to the maximum likelihood.
LIKELIHOOD_STEPS = 3


class _Low(NamedTuple):
    """Lowest bins, and powers of frequency around P places among them.

    Attributes:
        logarithm: of the number of each bin over that of the place, zero outside its window, shape
            (P, n).
        moments: its powers zero to two within the window, shape (3, P, n).
        between: shares of the places in the level of each of the t bins, shape (P, t).
    """

    logarithm: FloatArray
    moments: FloatArray
    between: FloatArray


@functools.lru_cache(maxsize=8)
def _low(bins: int) -> _Low:
    """Return the lowest of so many bins."""
    top = min(round(MIN_AVERAGED_BINS / MAX_WIDTH_FRACTION), bins - 1)
    places = distinct(np.round(np.geomspace(1, top, PLACES)).astype(int))
    number = np.arange(1, min(top + MIN_AVERAGED_BINS, bins - 1) + 1)
    window = np.abs(number - places[:, None]) <= MIN_AVERAGED_BINS
    logarithm = np.where(window, np.log(number / places[:, None]), 0.0)
    moments = np.where(window, logarithm ** np.arange(3)[:, None, None], 0.0)
    log_number = np.log(number[:top])
    between = np.stack([np.interp(log_number, np.log(places), row) for row in np.eye(len(places))])
    return _Low(logarithm, moments, between)


def level_of_noise(relative: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return the level around each bin such that noise over it has the mean one, shape (R, K).

    Args:
        relative: powers, shape (R, K).
        freedom: means of these where noise has the power one, shape (R, K).
    """
    bins = relative.shape[1]
    floored_freedom = np.maximum(freedom, MIN_FREEDOM)
    logarithm = np.log(np.maximum(relative / floored_freedom, 1e-300))
    level = np.exp(level_around(logarithm, floored_freedom) + np.euler_gamma)
    level *= floored_freedom
    ordinary = np.where(relative < MAX_POWER_RATIO * level, relative, level)
    place = np.arange(bins)
    width: int | NDArray[np.int_] = averaged_bins(bins)
    if width > MIN_AVERAGED_BINS:
        width = np.clip((place * MAX_WIDTH_FRACTION).astype(int), MIN_AVERAGED_BINS, width)
    weight = np.maximum(mean_around(freedom, width), MIN_FREEDOM)
    smooth = mean_around(ordinary, width)
    smooth /= weight
    # The inverse of a mean of n exponentially distributed powers is n / (n − 1) on average.
    count = np.maximum(2.0 * (width - NEAREST_BINS) * weight, 2.0)
    smooth *= count / (count - 1.0)
    low = _lowest(ordinary, floored_freedom)
    smooth[:, 1 : low.shape[1] + 1] = low
    smooth[:, 0] = smooth[:, 1]
    return smooth


def with_resonances(level: FloatArray, relative: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return the level, raised where noise has a resonance that is narrower than the mean around.

    There the mean over the nearest bins exceeds the level by more than chance makes it at one bin
    of a thousand, and is the level from where it rises above it to where it falls below. The chance
    is that of a χ² over its degrees of freedom, by its cube root (Wilson & Hilferty 1931).

    Args:
        level: by :func:`level_of_noise`, shape (R, K).
        relative: powers, shape (R, K).
        freedom: means of these where noise has the power one, shape (R, K).
    """
    weight = np.maximum(mean_around(freedom, RESONANCE_BINS), MIN_FREEDOM)
    near = mean_around(relative / np.maximum(level, MIN_POWER), RESONANCE_BINS) / weight
    count = 2.0 * (RESONANCE_BINS - NEAREST_BINS) * weight
    deviations = 3.0 * np.sqrt(count) * (np.cbrt(near) - 1.0) + 1.0 / (3.0 * np.sqrt(count))
    resonant = deviations > NormalDist().inv_cdf(1.0 - REJECTION)
    if not resonant.any():
        return level
    above = near > 1.0
    changes = np.diff(above, axis=1, prepend=~above[:, :1])
    run = np.cumsum(changes.ravel()).reshape(above.shape)
    holds_resonance = np.zeros(run[-1, -1] + 1, dtype=bool)
    holds_resonance[run[resonant]] = True
    mean_of_inverse = count / np.maximum(count - 1.0, 1.0)
    return np.where(holds_resonance[run], near * mean_of_inverse, 1.0) * level


def _lowest(power: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return the level of the lowest bins, from bin 1 on, by powers of frequency, shape (R, n)."""
    low = _low(power.shape[1])
    count, number = low.logarithm.shape
    power = power[:, 1 : number + 1]
    freedom = freedom[:, 1 : number + 1]
    sums = freedom @ low.moments.reshape(-1, number).T
    zeroth, first, second = np.split(sums, 3, axis=1)
    inverse_determinant = 1.0 / (zeroth * second - first**2 + 1e-9 * zeroth**2)
    flat = low.moments[:2].reshape(-1, number)

    def solved(right: FloatArray) -> tuple[FloatArray, FloatArray]:
        constant = right[:, :count]
        sloping = right[:, count:]
        level = (second * constant - first * sloping) * inverse_determinant
        return level, (zeroth * sloping - first * constant) * inverse_determinant

    logarithm = np.log(np.maximum(power / freedom, 1e-300)) + np.euler_gamma
    level, slope = solved((freedom * logarithm) @ flat.T)
    for _ in range(LIKELIHOOD_STEPS):
        excess = np.exp(slope[..., None] * -low.logarithm - np.maximum(level, -600.0)[..., None])
        excess *= power[:, None]
        excess -= freedom[:, None]
        right = np.einsum("rpn,ipn->rip", excess, low.moments[:2]).reshape(len(power), -1)
        steps = solved(right)
        level = level + np.clip(steps[0], -1.0, 1.0)
        slope = slope + np.clip(steps[1], -1.0, 1.0)
    return np.exp(level @ low.between)

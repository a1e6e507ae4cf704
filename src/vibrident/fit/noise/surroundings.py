"""The level of noise around each bin, relative to a shape that it nearly has.

Far from frequency zero it is the mean over the bins on either side. In the lowest bins noise may be
steep within so many: there a power of frequency is fitted to the bins around a few places by
likelihood (a generalised linear model of exponentially distributed powers with a logarithmic link:
McCullagh & Nelder 1989, ch. 8), and between the places it is interpolated.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.noise.averages import (
    MIN_AVERAGED_BINS,
    NEAREST_BINS,
    averaged_bins,
    level_around,
    mean_around,
)

#: Powers beyond this many times the level are no noise: one of 22,000 white ones is.
MAX_POWER_RATIO = 10.0
#: Least degrees of freedom of a bin whose power says anything.
MIN_FREEDOM = 1e-3
#: Bins on either side are at most this part of a bin's number: within them noise is not steep.
STEEP_PART = 1 / 4
#: Places at which a power of frequency is fitted.
PLACES = 14
#: Steps to the greatest likelihood.
LIKELIHOOD_STEPS = 3


class _Low(NamedTuple):
    """The lowest bins.

    Attributes:
        places: bins at which a power is fitted, shape (P,).
        logarithm: of each bin's number over the place's, zero outside its window, shape (P, n).
        window: whether a bin is in the window, shape (P, n).
        between: shares of the places in each bin's level, shape (P, n).
    """

    places: NDArray[np.int_]
    logarithm: FloatArray
    window: FloatArray
    between: FloatArray


@functools.lru_cache(maxsize=8)
def _low(bins: int) -> _Low:
    """Return the lowest bins of so many."""
    top = min(round(MIN_AVERAGED_BINS / STEEP_PART), bins - 1)
    places = distinct(np.round(np.geomspace(1, top, PLACES)).astype(int))
    number = np.arange(1, min(top + MIN_AVERAGED_BINS, bins - 1) + 1)
    window = (np.abs(number - places[:, None]) <= MIN_AVERAGED_BINS).astype(float)
    logarithm = np.log(number / places[:, None]) * window
    between = np.stack(
        [np.interp(np.log(number[:top]), np.log(places), row) for row in np.eye(len(places))]
    )
    return _Low(places, logarithm, window, between)


def level_of_noise(relative: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return the level around each bin such that noise over it has the mean one, shape (R, K).

    Args:
        relative: powers, shape (R, K).
        freedom: means of these where noise has the power one, shape (R, K).
    """
    bins = relative.shape[1]
    shown = np.maximum(freedom, MIN_FREEDOM)
    logarithm = np.log(np.maximum(relative / shown, 1e-300))
    level = np.exp(level_around(logarithm, shown) + np.euler_gamma)
    level *= shown
    ordinary = np.where(relative < MAX_POWER_RATIO * level, relative, level)
    place = np.arange(bins)
    width: int | NDArray[np.int_] = averaged_bins(bins)
    if width > MIN_AVERAGED_BINS:
        width = np.clip((place * STEEP_PART).astype(int), MIN_AVERAGED_BINS, width)
    weight = np.maximum(mean_around(freedom, width), MIN_FREEDOM)
    smooth = mean_around(ordinary, width)
    smooth /= weight
    # The inverse of a mean of n exponentially distributed powers is n / (n − 1) on average.
    count = np.maximum(2.0 * (width - NEAREST_BINS) * weight, 2.0)
    smooth *= count / (count - 1.0)
    low = _lowest(ordinary, shown)
    smooth[:, 1 : low.shape[1] + 1] = low
    smooth[:, 0] = smooth[:, 1]
    return smooth


def _lowest(power: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return the level of the lowest bins, from bin 1 on, by powers of frequency, shape (R, n)."""
    low = _low(power.shape[1])
    bins = slice(1, low.window.shape[1] + 1)
    power, freedom = power[:, bins], freedom[:, bins]
    basis = np.stack([low.window, low.logarithm], axis=1)  # (P, 2, n)
    gram = np.einsum("pan,pbn,rn->rpab", basis, basis, freedom, optimize=True)
    gram += 1e-9 * np.eye(2)
    inverse = np.linalg.inv(gram)
    logarithm = np.log(np.maximum(power / freedom, 1e-300)) + np.euler_gamma
    flat = basis.reshape(-1, power.shape[1])
    right = ((freedom * logarithm) @ flat.T).reshape(len(power), -1, 2)
    amounts = (inverse @ right[..., None])[..., 0]
    for _ in range(LIKELIHOOD_STEPS):
        level = amounts[..., :1] + amounts[..., 1:] * low.logarithm
        beyond = power[:, None] * np.exp(np.minimum(-level, 700.0)) - freedom[:, None]
        right = np.stack(
            [np.sum(beyond * low.window, axis=-1), np.sum(beyond * low.logarithm, axis=-1)], axis=-1
        )
        amounts += np.clip((inverse @ right[..., None])[..., 0], -1.0, 1.0)
    return np.exp(amounts[..., 0] @ low.between)

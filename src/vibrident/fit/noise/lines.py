"""Bins at which the motion has a line of its own."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.averages import mean_around

#: A bin this many times above its surroundings is no chance: one of 10⁹ white ones is.
OUTSTANDING_RATIO = 20.0
#: Bins on either side that are the nearest.
CLOSE_BINS = 8


def lines_of_motion(
    expected: FloatArray, log_expected: FloatArray, log_through: FloatArray | None, width: int
) -> BoolArray:
    """Return where the motion has a line of its own: a remainder there is the model's, no hum.

    Lines stand out of all around, or of the nearest, as a multisine's do; a resonance is no line.
    """
    stands = expected > OUTSTANDING_RATIO * mean_around(expected, width)
    logarithm = log_expected if log_through is None else log_expected - log_through
    close = logarithm - mean_around(logarithm, CLOSE_BINS)
    lines = close > np.log(OUTSTANDING_RATIO) + np.euler_gamma
    lines[:, 1:] &= logarithm[:, 1:] >= logarithm[:, :-1]
    lines[:, :-1] &= logarithm[:, :-1] >= logarithm[:, 1:]
    stands |= lines
    stands[:, 1:] |= lines[:, :-1]
    stands[:, :-1] |= lines[:, 1:]
    return stands

"""Bins at which the motion has a line."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.averages import MIN_POWER, averaged_bins, log_power, mean_around

#: A bin this many times above its surroundings is no chance: one of 10⁹ white ones is.
OUTSTANDING_RATIO = 20.0
#: Bins on either side that count as the nearest.
CLOSE_BINS = 8


def lines_of_motion(
    expected: FloatArray, log_expected: FloatArray, log_through: FloatArray | None, width: int
) -> BoolArray:
    """Return the bins of lines of the motion, whose remainder is the model's and no hum.

    Lines stand out of all bins around, or of the nearest, as a multisine's do; a resonance is no
    line.

    Args:
        expected: power of the prediction, shape (R, K).
        log_expected: its logarithm, shape (R, K).
        log_through: logarithm of g |H|², shape (R, K) or (1, K); None without a reference.
        width: bins on either side of a bin around it.
    """
    stands_out = expected > OUTSTANDING_RATIO * mean_around(expected, width)
    logarithm = log_expected if log_through is None else log_expected - log_through
    excess = logarithm - mean_around(logarithm, CLOSE_BINS)
    lines = excess > np.log(OUTSTANDING_RATIO) + np.euler_gamma
    lines[:, 1:] &= logarithm[:, 1:] >= logarithm[:, :-1]
    lines[:, :-1] &= logarithm[:, :-1] >= logarithm[:, 1:]
    stands_out |= lines
    stands_out[:, 1:] |= lines[:, :-1]
    stands_out[:, :-1] |= lines[:, 1:]
    return stands_out


def level_with_lines(expected: FloatArray, log_expected: FloatArray, width: int) -> FloatArray:
    """Return the level of the prediction's power around each bin, or that of a line, shape (R, K).

    Args:
        expected: power of the prediction, shape (R, K).
        log_expected: its logarithm, shape (R, K).
        width: bins on either side of a bin around it.
    """
    level = np.exp(mean_around(log_expected, width) + np.euler_gamma)
    np.copyto(level, expected, where=expected > OUTSTANDING_RATIO * level)
    return level


def noise_in_prediction(expected: FloatArray, passed: FloatArray) -> FloatArray:
    """Return the share of the prediction's power that noise of the reference makes, shape (R, K).

    The remainder can be predicted from a noisy reference (Wiener 1949).

    Args:
        expected: power of the prediction, shape (R, K).
        passed: power of the noise of the reference behind the sensor, shape (R, K).
    """
    level = level_with_lines(expected, log_power(expected), averaged_bins(expected.shape[1]))
    return np.minimum(passed / np.maximum(level, MIN_POWER), 1.0)

"""Autoregression of a series, of the order with the least information criterion."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray


def yule_walker(lags: FloatArray, count: float) -> tuple[FloatArray, float]:
    """Return the prediction-error filter, its first coefficient one, and its residual variance.

    Levinson's recursion, of the order with the least information criterion (Schwarz 1978).

    Args:
        lags: autocovariance, shape (orders + 1,).
        count: number of samples behind it.
    """
    filters = np.ones(1)
    variance = float(lags[0])
    best = 0.0, filters, variance
    for order in range(1, len(lags)):
        reflection = -float(filters @ lags[order:0:-1]) / variance
        if not reflection**2 < 1.0:  # pure tones: no longer an autocovariance
            break
        filters = np.append(filters, 0.0) + reflection * np.append(0.0, filters[::-1])
        variance *= 1.0 - reflection**2
        criterion = float(count * np.log(variance / lags[0]) + order * np.log(count))
        if criterion < best[0]:
            best = criterion, filters, variance
    return best[1:]

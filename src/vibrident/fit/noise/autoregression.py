"""The filter that whitens a series from its own past, of the order with the least information criterion."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray


def yule_walker(lags: FloatArray, count: float) -> tuple[FloatArray, float]:
    """Prediction-error filter by Levinson's recursion, its first coefficient one, and the variance that it leaves.

    Of the order with the least information criterion (Schwarz 1978).

    Args:
        lags: autocovariance, shape (orders + 1,).
        count: number of samples behind it.
    """
    filters, left = np.ones(1), float(lags[0])
    kept = 0.0, filters, left
    for order in range(1, len(lags)):
        reflection = -float(filters @ lags[order:0:-1]) / left
        if not reflection**2 < 1.0:  # of pure tones: the estimate is no autocovariance any more
            break
        filters = np.append(filters, 0.0) + reflection * np.append(0.0, filters[::-1])
        left *= 1.0 - reflection**2
        criterion = float(count * np.log(left / lags[0]) + order * np.log(count))
        if criterion < kept[0]:
            kept = criterion, filters, left
    return kept[1:]

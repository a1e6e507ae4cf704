"""Slow changes of the noise of a record in time."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray

#: Most stretches of a record over which its noise may change …
MAX_STRETCHES = 16
#: … and fewest samples of one.
MIN_STRETCH_SAMPLES = 128


def slow_profile(white: FloatArray, used: BoolArray) -> FloatArray:
    """Return the noise power in time over its mean, shape (samples,).

    Args:
        white: whitened residual, shape (samples,).
        used: samples that count, shape (samples,).
    """
    count = int(used.sum())
    stretches = int(np.clip(count // MIN_STRETCH_SAMPLES, 1, MAX_STRETCHES))
    if stretches < 2:
        return np.ones(white.size)
    edges = np.linspace(0, white.size, stretches + 1).astype(int)
    squares = np.add.reduceat(np.where(used, white**2, 0.0), edges[:-1])
    number = np.add.reduceat(used.astype(float), edges[:-1])
    mean = squares.sum() / number.sum()
    level = np.where(
        number > 0.5 * np.diff(edges), squares / np.maximum(number, 1.0) / max(mean, 1e-300), 1.0
    )
    return np.interp(np.arange(white.size), 0.5 * (edges[1:] + edges[:-1]), np.maximum(level, 1e-3))

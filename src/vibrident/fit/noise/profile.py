"""Slow changes of a record's noise in time."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray

#: Stretches of a record over which its noise may change, and the least samples of one.
STRETCHES, LEAST = 16, 128


def slow_profile(white: FloatArray, used: BoolArray) -> FloatArray:
    """Noise power in time over its mean, of a whitened residual, each of shape (samples,)."""
    count = int(used.sum())
    stretches = int(np.clip(count // LEAST, 1, STRETCHES))
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

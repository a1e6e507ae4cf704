"""Smooth curves of time: Legendre polynomials up to the fifth degree."""

from __future__ import annotations

import functools

import numpy as np

from vibrident.data.records import FloatArray

#: Highest degree.
DEGREE = 5


@functools.lru_cache(maxsize=2)
def smooth_curves(samples: int) -> FloatArray:
    """Return the curves over so many samples, without the constant, shape (5, n)."""
    time = np.linspace(-1.0, 1.0, samples)
    return np.ascontiguousarray(np.polynomial.legendre.legvander(time, DEGREE).T[1:], dtype=float)

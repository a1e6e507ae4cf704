"""Leakage of noise into quieter bins: alike in many of them, and so of little information."""

from __future__ import annotations

import functools

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.response import ComplexArray


def beside_leakage(psd: FloatArray, lines: BoolArray | None = None) -> FloatArray:
    """Return the noise raised where leakage makes bins alike, shape (K,).

    A record cut out of noise leaks from bin m to bin k a power of S(m)/(2π² (k − m)²), and that is
    alike in about |k − m| bins. Where the noise of a bin is leakage, it counts as many times.

    Args:
        psd: noise at each bin, leakage included, shape (K,).
        lines: bins of lines of the motion, shape (K,): of these and below them no noise leaks, but
            the remainder of the motion; None: none.
    """
    noise = np.ones(len(psd))
    if lines is not None:
        noise[lines] = 0.0
        noise[: np.argmax(lines)] = 0.0
    rows = np.stack([psd, np.ones_like(psd)]) * noise
    # Bins of one level leak as much into each other as they lose.
    alike, leaked = (
        np.maximum(of_psd - psd * of_one, 0.0) for of_psd, of_one in _sums_around(rows)
    )
    share = np.minimum(leaked / np.maximum(psd, np.finfo(float).tiny), 1.0)
    return np.asarray(psd + share * alike)


def _sums_around(rows: FloatArray) -> FloatArray:
    """Return sums over all bins by the inverse of their distance and by its square, (2, R, K)."""
    bins = rows.shape[1]
    length = fast_length(3 * bins)
    product = fft.rfft(rows, length, axis=1) * _kernels(bins)[:, None]
    sums = np.asarray(fft.irfft(product, length, axis=2)[..., bins - 1 : 2 * bins - 1])
    return np.maximum(sums, 0.0)


@functools.lru_cache(maxsize=8)
def _kernels(bins: int) -> ComplexArray:
    """Return the transforms of 1/(2π² d) and 1/(2π² d²) over distances d, zero at zero, (2, L)."""
    distance = np.maximum(np.abs(np.arange(1 - bins, bins)), 1).astype(float)
    kernel = 1.0 / (2.0 * np.pi**2 * distance)
    kernel[bins - 1] = 0.0
    transforms: ComplexArray = fft.rfft(
        np.stack([kernel, kernel / distance]), fast_length(3 * bins)
    )
    transforms.flags.writeable = False
    return transforms

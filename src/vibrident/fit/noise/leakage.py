"""Leakage of noise into quieter bins: alike in many of them, and so of little information."""

from __future__ import annotations

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray


def beside_leakage(psd: FloatArray, lines: BoolArray | None = None) -> FloatArray:
    """Return the noise raised where leakage makes bins alike, shape (K,).

    A record cut out of noise leaks from bin m to bin k a power of S(m)/(2π² (k − m)²), and that is
    alike in about |k − m| bins. Where the noise of a bin is leakage, it counts as many times.

    Args:
        psd: noise at each bin, leakage included, shape (K,).
        lines: bins of lines of the motion, shape (K,): of these and below them no noise leaks, but
            the remainder of the motion; None: none.
    """
    distance = np.maximum(np.abs(np.arange(1 - len(psd), len(psd))), 1).astype(float)
    kernel = 1.0 / (2.0 * np.pi**2 * distance)
    kernel[len(psd) - 1] = 0.0
    noise = np.ones(len(psd))
    if lines is not None:
        noise[lines] = 0.0
        noise[: np.argmax(lines)] = 0.0
    rows = np.stack([psd, np.ones_like(psd)]) * noise
    # Bins of one level leak as much into each other as they lose.
    sums = (_around(rows, weights) for weights in (kernel, kernel / distance))
    alike, leaked = (np.maximum(of_psd - psd * of_one, 0.0) for of_psd, of_one in sums)
    share = np.minimum(leaked / np.maximum(psd, np.finfo(float).tiny), 1.0)
    return np.asarray(psd + share * alike)


def _around(rows: FloatArray, kernel: FloatArray) -> FloatArray:
    """Return sums over all bins by a kernel of their distance, shape (R, K).

    Args:
        rows: shape (R, K).
        kernel: shape (2 K − 1,).
    """
    bins = rows.shape[1]
    length = fast_length(3 * bins)
    product = fft.rfft(rows, length, axis=1) * fft.rfft(kernel, length)
    sums = np.asarray(fft.irfft(product, length, axis=1)[:, bins - 1 : 2 * bins - 1])
    return np.maximum(sums, 0.0)

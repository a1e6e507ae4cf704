"""Straight drift of the zero of a free decay, separated from slow noise.

The drift of records with a reference is a departure from the fit
(:mod:`vibrident.fit.departures.kinds.drift`).
"""

from __future__ import annotations

import math

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import hann

#: Number of slow lines that bound how far noise alone may wander.
LINES = 8
#: A drift is significant above this many standard deviations of the noise of those lines …
MIN_RISE_DEVIATIONS = 8.0
#: … and above this fraction of the standard deviation of the response.
MIN_RELATIVE_RISE = 0.02


def significant_rise(residual: FloatArray, times_s: FloatArray, size: float) -> float:
    """Return the slope of a residual, 1/s, or zero where its slow noise may explain it.

    Args:
        residual: shape (used,); overwritten.
        times_s: shape (used,); overwritten.
        size: standard deviation of the response.
    """
    duration = float(np.ptp(times_s))
    times_s -= float(np.mean(times_s))
    rise, deviation = _trend(residual, times_s)
    limit = max(MIN_RISE_DEVIATIONS * deviation * duration, MIN_RELATIVE_RISE * size)
    return rise if abs(rise) * duration > limit else 0.0


def _trend(residual: FloatArray, t: FloatArray) -> tuple[float, float]:
    """Return the slope by weighted least squares, 1/s, and its standard deviation.

    The deviation holds for noise as strong as the slowest lines. The weights fade towards both
    ends: without them noise of all frequencies would affect the slope, and that of a displacement
    channel grows with their cube.

    Args:
        residual: shape (used,); overwritten, as a long record has no memory to spare.
        t: times from their mean, shape (used,); overwritten.
    """
    window = hann(residual.shape[0])
    total = float(np.sum(window))
    residual -= float(window @ residual) / total
    t -= float(window @ t) / total
    residual *= window
    slope = float(residual @ t)
    t *= window
    weighted = float(t @ t)  # of the slope's own noise
    power = float(t @ (t / np.maximum(window, np.finfo(float).tiny)))
    slope /= power
    t *= slope
    residual -= t
    level = float(np.mean(np.abs(_slow_lines(residual)) ** 2) / (window @ window))
    return slope, float(np.sqrt(level * weighted)) / power


def _slow_lines(series: FloatArray) -> ComplexArray:
    """Return lines 2 to LINES + 1 of the discrete Fourier transform, shape (LINES,).

    With sample j = a w + b, e^{−2πi k j/n} is a product of a factor of a and one of b, so a product
    of matrices suffices. A fast transform of an unfavourable number of samples would need many
    times the memory of the record.
    """
    n = series.shape[0]
    width = math.isqrt(n)
    rows = n // width
    turn = -2j * np.pi / n * np.arange(2, 2 + LINES)
    inner = np.exp(np.arange(width)[:, None] * turn)
    outer = np.exp(width * np.arange(rows)[:, None] * turn)
    body = series[: rows * width].reshape(rows, width)
    remainder = series[rows * width :]
    sums = body @ inner.real + 1j * (body @ inner.imag)
    return np.sum(outer * sums, axis=0) + remainder @ np.exp(
        np.arange(rows * width, n)[:, None] * turn
    )

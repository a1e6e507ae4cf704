"""Bins of exponentials, tones and free motion, in closed form: no transform is taken."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.bins.segments import shifted_lines
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A tone is on a bin where it turns from sample to sample by less than this otherwise, in radians:
#: there the sum of the geometric series is the number of its terms.
MAX_BIN_ANGLE = 1e-11


def wave_bins(exponents: ComplexArray, weight: BoolArray | FloatArray, bins: int) -> ComplexArray:
    """Return the bins of e^{st}, t = 0, 1 … in samples, shape (m, bins).

    Args:
        exponents: s, a sample, shape (m,).
        weight: of the samples, by which the waves are multiplied, shape (N,).
        bins: number of bins, from 0 on.
    """
    samples = weight.size
    if not np.all(weight == 1.0):
        waves = np.exp(exponents[:, None] * np.arange(samples)) * weight
        return np.asarray(np.fft.fft(waves, axis=1)[:, :bins])
    _ratio, remainder, on_bin = _series(exponents, samples, bins)
    remainder[on_bin] = 1.0
    total = -np.expm1(samples * exponents)[:, None] / remainder
    total[on_bin] = samples
    return total


def motion_bins(
    exponents: ComplexArray, weight: BoolArray | FloatArray, bins: int, *, growing: bool
) -> ComplexArray:
    """Return the bins of Re e^{st} and Im e^{st}, shape (columns, bins).

    The imaginary part of a real exponent is zero and left out.

    Args:
        exponents: s, a sample, shape (m,).
        weight: of the samples, by which the motion is multiplied, shape (N,).
        bins: number of bins, from 0 on.
        growing: whether t times each of these follows, too.
    """
    turning = exponents.imag != 0.0
    both = np.concatenate([exponents, np.conj(exponents[turning])])
    waves = [wave_bins(both, weight, bins)]
    if growing:
        waves.append(_growing_bins(both, weight, bins))
    columns = list[ComplexArray]()
    for rows in waves:
        ahead = rows[: exponents.size]
        behind = ahead.copy()
        behind[turning] = rows[exponents.size :]
        columns += [0.5 * (ahead + behind), (-0.5j * (ahead - behind))[turning]]
    return np.concatenate(columns)


def _growing_bins(
    exponents: ComplexArray, weight: BoolArray | FloatArray, bins: int
) -> ComplexArray:
    """Return the bins of t e^{st} / N, shape (m, bins); arguments as of :func:`wave_bins`."""
    samples = weight.size
    if not np.all(weight == 1.0):
        time = np.arange(samples)
        waves = np.exp(exponents[:, None] * time) * (time / samples * weight)
        return np.asarray(np.fft.fft(waves, axis=1)[:, :bins])
    ratio, remainder, on_bin = _series(exponents, samples, bins)
    remainder[on_bin] = 1.0
    last = np.exp(samples * exponents)[:, None]
    total = (ratio * (1.0 - last) / (samples * remainder) - last) / remainder
    total[on_bin] = 0.5 * (samples - 1.0)
    return total


def _series(
    exponents: ComplexArray, samples: int, bins: int
) -> tuple[ComplexArray, ComplexArray, BoolArray]:
    """Return the ratio q of the geometric series at each bin, 1 − q, and whether that is zero."""
    turns = np.conj(1.0 + shifted_lines(samples, slice(0, bins)))
    ratio = np.asarray(np.exp(exponents)[:, None] * turns, dtype=complex)
    remainder = np.asarray(1.0 - ratio, dtype=complex)
    return ratio, remainder, power_of(remainder) < MAX_BIN_ANGLE**2

"""Covariance of a least-squares estimate when the residual is not white.

With J the (weighted) Jacobian and S(f) the residual's spectrum, relative to white noise of the variance used as weight,

    cov = (JᵀJ)⁻¹ [Σ_f S(f) J(f) J(f)ᴴ] (JᵀJ)⁻¹                    (Ljung 1999, sec. 9.4; White's sandwich in frequency)

S is the record's own periodogram, averaged over the lines around each line. White noise gives (JᵀJ)⁻¹ back, up to the
spectrum's own scatter; hum, drift, 1/f noise, and noise of the reference that the sensor did not feel, are counted
where they stand in the spectrum.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft

from vibrident.estimators.covariance import inverse_normal
from vibrident.network.sensitivity import Normal
from vibrident.problem import TimeProblem
from vibrident.records import FloatArray, Record

#: Lines averaged on either side of each: a part of the spectrum, within these numbers; the nearest are left out.
SHARE, FEWEST, MOST, NEAREST = 1 / 256, 12, 200, 2


def coloured_covariance(
    problem: TimeProblem,
    normal: Normal,
    noise: FloatArray,
    floor: FloatArray,
    shapes: Sequence[FloatArray | None] = (),
) -> tuple[FloatArray, float]:
    """Covariance of the parameters, shape (P, P), and the degrees of freedom behind it.

    Args:
        problem: the records.
        normal: the normal equations at the optimum.
        noise: standard deviation by which each record was weighted, shape (records,).
        floor: standard deviation that no residual is believed to be below, shape (records,).
        shapes: of each record's residual spectrum, where more is known of it than averages over lines can show; up to
            a factor, shape (samples // 2 + 1,).
    """
    inverse = inverse_normal(np.asarray(normal.matrix))
    predicted = problem.by_record(normal.response)
    columns = [problem.by_record(column) for column in normal.columns]
    middle = np.zeros_like(inverse)
    freedom = 0.0
    for index, record in enumerate(problem.records):
        used = record.mask & np.isfinite(predicted[index])
        if used.sum() < 4 * FEWEST:
            continue
        residual = np.where(used, (record.response - predicted[index]) / noise[index], 0.0)
        slopes = np.stack([np.where(used, column[index], 0.0) for column in columns])
        width = _width(record)
        level = _level(residual, used, width, shapes[index] if shapes else None)
        level = np.maximum(level, (floor[index] / noise[index]) ** 2)
        lines = np.asarray(fft.rfft(slopes, axis=1))
        twice = np.full(lines.shape[1], 2.0)
        twice[0] = 1.0
        if record.samples % 2 == 0:
            twice[-1] = 1.0
        middle += np.real((lines * (twice * level)) @ np.conj(lines).T) / record.samples
        freedom += 4.0 * (width - NEAREST)
    return inverse @ middle @ inverse, freedom


def _width(record: Record) -> int:
    return int(np.clip(record.samples * SHARE, FEWEST, MOST))


def _level(residual: FloatArray, used: np.ndarray, width: int, shape: FloatArray | None) -> FloatArray:
    """Spectrum of the residual around each line of its real transform, one for white noise of unit variance."""
    whitened = np.ones(residual.shape[0] // 2 + 1) if shape is None else np.maximum(shape, 1e-9 * np.max(shape))
    power = np.abs(np.asarray(fft.rfft(residual))) ** 2 / float(used.sum()) / whitened
    padded = np.concatenate([power[width:0:-1], power, power[-2 : -width - 2 : -1]])
    total = np.concatenate([[0.0], np.cumsum(padded)])

    def windowed(reach: int) -> FloatArray:
        centre = np.arange(power.size) + width
        return total[centre + reach + 1] - total[centre - reach]

    return whitened * (windowed(width) - windowed(NEAREST)) / (2.0 * (width - NEAREST))

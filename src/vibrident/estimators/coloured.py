"""Covariance of a least-squares estimate when the residual is not white.

With J the (weighted) Jacobian and S(f) the residual's spectrum, relative to white noise of the variance used as weight,

    cov = (JᵀJ)⁻¹ [Σ_f S(f) J(f) J(f)ᴴ] (JᵀJ)⁻¹                    (Ljung 1999, sec. 9.4; White's sandwich in frequency)

S is the record's own periodogram, averaged over the lines around each line. White noise gives (JᵀJ)⁻¹ back, up to the
spectrum's own scatter; hum, drift and 1/f noise are counted where they stand in the spectrum.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from vibrident.estimators.covariance import inverse_normal
from vibrident.estimators.noise_spectrum import NEAREST, mean_around
from vibrident.measure.lines import line_counts
from vibrident.network.sensitivity import Normal
from vibrident.problem import TimeProblem
from vibrident.records import FloatArray, Record

#: Lines averaged on either side of each: a part of the spectrum, within these numbers.
SHARE, FEWEST, MOST = 1 / 256, 12, 200


def coloured_covariance(
    problem: TimeProblem,
    normal: Normal,
    noise: FloatArray,
) -> tuple[FloatArray, float]:
    """Covariance of the parameters, shape (P, P), and the degrees of freedom behind it.

    Args:
        problem: the records.
        normal: the normal equations at the optimum.
        noise: standard deviation by which each record was weighted, shape (records,).
    """
    inverse = inverse_normal(np.asarray(normal.matrix))
    predicted = problem.by_record(normal.response)
    columns = [problem.by_record(column) for column in normal.columns]
    middle = np.zeros_like(inverse)
    freedom = 0.0
    for index, record in enumerate(problem.records):
        used = record.mask & np.isfinite(predicted[index])
        count = float(used.sum())
        if count == 0.0:
            continue
        residual = np.where(used, (record.response - predicted[index]) / noise[index], 0.0)
        slopes = np.stack([np.where(used, column[index], 0.0) for column in columns])
        width = _width(record)
        power = np.abs(np.asarray(fft.rfft(residual))) ** 2 / count
        if count < 4 * FEWEST:  # too few lines for a mean around each
            level, own = np.ones_like(power), max(float(problem.degrees_of_freedom[index]), 1.0)
        else:
            level, own = mean_around(power, width, NEAREST), 4.0 * (width - NEAREST)
        level = np.maximum(level, (problem.noise_floor[index] / noise[index]) ** 2)
        lines = np.asarray(fft.rfft(slopes, axis=1))
        weight = line_counts(record.samples) * level / record.samples
        middle += np.real((lines * weight) @ np.conj(lines).T)
        freedom += own
    return inverse @ middle @ inverse, freedom


def _width(record: Record) -> int:
    return int(np.clip(record.samples * SHARE, FEWEST, MOST))

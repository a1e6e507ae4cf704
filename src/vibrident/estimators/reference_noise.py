"""Noise of the reference that the sensor did not feel: how strong it is, and how far it moves an output-error fit.

The network compares the response with what the *measured* reference would have caused. White noise of variance σx² on
the reference alone adds N σx² M(z), M = mean|H(z)|², to the cost, which grows with the gain: the fit is drawn towards
less of it. The estimate without that bias is the optimum of the cost less this term (compensated least squares;
Söderström 2018, ch. 3), where, with ẑ the network's optimum and F the cost's curvature there,

    F (z − ẑ) = N σx² ∂M/∂z,    F = 2 JᵀJ + N σx² (∂²M/∂z² − 2 mean ∂H* ∂H).

The residual tells σx² where the sensor's response has a shape: its spectrum is a + c/f + σx²|H|². Where |H|² is level
over the band, a and σx² cannot be told apart, and the bias stays in doubt between none and all of the residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg
from scipy.special import gammaln

from vibrident.estimators.covariance import inverse_normal
from vibrident.measure.response import ComplexArray
from vibrident.network.sensitivity import Normal
from vibrident.problem import Coordinates, TimeProblem
from vibrident.records import FloatArray, Quantity, Record

#: Bins that a spectrum is averaged into, and the part of the sampling rate up to which it is looked at.
BINS, HIGHEST = 160, 0.4
#: Frequencies at which a spectrum is averaged.
GRID = 4000
#: Multiplicative updates of the three levels.
ROUNDS = 150
#: σx² is believed beyond this many standard deviations; the doubt left is this many.
SIGNIFICANT, DOUBT = 4.0, 2.0
#: Levels below this part of the mean are not believed.
LEAST_LEVEL = 1e-12
#: What noise makes of the Jacobian is taken out of the curvature down to this part.
LEAST_CURVATURE = 0.2
#: Step of the central differences.
STEP = 1e-5


@dataclass(frozen=True)
class ReferenceNoise:
    """What noise of the reference does to an estimate.

    Attributes:
        deviation: its standard deviation in each record, SI unit of the reference; zero where it is not seen,
            shape (records,).
        bias: of z, to be taken away, shape (p,).
        doubt: by how much that may be wrong, shape (p,).
        spectra: shape of each record's residual spectrum at the lines of its real transform, where such noise is seen:
            with a sharp resonance it cannot be read from averages over lines. None where it is not.
    """

    deviation: FloatArray
    bias: FloatArray
    doubt: FloatArray
    spectra: tuple[FloatArray | None, ...]


def reference_noise(
    problem: TimeProblem, normal: Normal, noise: FloatArray, coordinates: Coordinates, z: FloatArray
) -> ReferenceNoise:
    """Read the noise of each record's reference from the network's residual, and what it does to the estimate.

    Args:
        problem: the records.
        normal: the normal equations at ``z``.
        noise: standard deviation by which each record was weighted, shape (records,).
        coordinates: the map from z to parameters.
        z: the optimum, shape (p,).
    """
    predicted = problem.by_record(normal.response)
    quantity = problem.layout.quantity
    deviation = np.zeros(len(problem.records))
    seen: list[_Weight] = []
    spectra: list[FloatArray | None] = [None] * len(problem.records)
    doubted: list[_Weight] = []
    for index, record in enumerate(problem.records):
        used = record.mask & np.isfinite(predicted[index])
        if record.reference is None or used.sum() < 256:
            continue
        residual = np.where(used, (record.response - predicted[index]) / noise[index], 0.0)
        frequency, level, count = _spectrum(residual, used, record)
        through = np.abs(_response(coordinates, z, quantity, frequency)) ** 2
        variance, spread, rest = _passed(frequency, level, count, through)
        most, samples = float(np.min(level / through)), float(used.sum())
        sure = variance > SIGNIFICANT * spread
        if sure:
            deviation[index] = np.sqrt(variance) * noise[index]
            lines = np.arange(1, record.samples // 2 + 1) * record.sampling_rate_hz / record.samples
            shape = np.interp(lines, frequency, rest)
            shape += variance * np.abs(_response(coordinates, z, quantity, lines)) ** 2
            spectra[index] = np.concatenate([shape[:1], shape])
            seen.append(_Weight(samples * variance, _grid(record)))
        left = min(DOUBT * spread if sure else variance + DOUBT * spread, most)
        doubted.append(_Weight(samples * left, _grid(record)))
    matrix = np.asarray(normal.matrix)
    bias = _bias(matrix, seen, coordinates, z, quantity)
    doubt = np.abs(_bias(matrix, doubted, coordinates, z, quantity, rounds=1))
    return ReferenceNoise(deviation, bias, doubt, tuple(spectra))


@dataclass(frozen=True, eq=False)
class _Weight:
    """N σx² of a record, and the frequencies of its sampled spectrum."""

    amount: float
    frequency_hz: FloatArray


def _bias(
    matrix: FloatArray,
    weights: list[_Weight],
    coordinates: Coordinates,
    z: FloatArray,
    quantity: Quantity,
    rounds: int = 4,
) -> FloatArray:
    """Shift of the optimum by Σ N σx² M(z), from the equation in the module's text; shape (p,)."""
    bias = np.zeros(len(z))
    if not weights:
        return bias

    def slope(at: FloatArray) -> FloatArray:
        total = np.zeros(len(z))
        for weight in weights:
            total += weight.amount * _slope(coordinates, at, quantity, weight.frequency_hz)[0]
        return total

    curvature = 2.0 * matrix
    if rounds > 1:
        for index in range(len(z)):
            step = np.zeros(len(z))
            step[index] = STEP
            curvature[index] += (slope(z + step) - slope(z - step)) / (2.0 * STEP)
        for weight in weights:
            curvature = curvature - 2.0 * weight.amount * _slope(coordinates, z, quantity, weight.frequency_hz)[1]
    inverse = _inverse(0.5 * (curvature + curvature.T), 2.0 * matrix)
    for _ in range(rounds):
        bias = -inverse @ slope(z - bias)
    return bias


def _inverse(curvature: FloatArray, plain: FloatArray) -> FloatArray:
    """Inverse of the curvature, which is not let fall below a part of the plain one, 2 JᵀJ."""
    scale = np.sqrt(np.maximum(np.diag(plain), np.finfo(float).tiny))
    base = plain / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    values, vectors = linalg.eigh(curvature / np.outer(scale, scale), base)
    return (vectors / np.maximum(values, LEAST_CURVATURE)) @ vectors.T / np.outer(scale, scale)


def _spectrum(residual: FloatArray, used: np.ndarray, record: Record) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Centre frequencies, mean levels (one for white noise of unit variance) and numbers of lines of bins."""
    n = record.samples
    power = np.abs(np.asarray(fft.rfft(residual))) ** 2 / float(used.sum())
    last = max(int(HIGHEST * n), 8)
    edges = np.unique(np.round(np.geomspace(1, last + 1, BINS)).astype(int))
    count = np.diff(edges).astype(float)
    # Geometric means: a tone that is not quite fitted, or hum, is not the noise looked for. That of n exponentially
    # distributed powers has the mean Γ(1 + 1/n)ⁿ times theirs.
    total = np.add.reduceat(np.log(np.maximum(power[: last + 1], 1e-300)), edges[:-1])
    level = np.exp(total / count - count * gammaln(1.0 + 1.0 / count))
    centre = 0.5 * (edges[1:] + edges[:-1] - 1.0) * record.sampling_rate_hz / n
    return centre, np.maximum(level, 1e-300), count


def _passed(
    frequency: FloatArray, level: FloatArray, count: FloatArray, through: FloatArray
) -> tuple[float, float, FloatArray]:
    """σx² (in squares of the record's weight), its standard deviation, and a + c/f, by likelihood.

    Means of exponentially distributed lines; multiplicative updates keep the three levels positive (Févotte, Bertin &
    Durrieu 2009); the deviation is from Fisher's information.
    """
    size, scale = float(np.average(level, weights=count)), float(np.max(through))
    level = np.maximum(level / size, LEAST_LEVEL)
    shapes = np.stack([np.ones_like(frequency), frequency[0] / frequency, np.maximum(through / scale, LEAST_LEVEL)])
    amounts = np.full(3, 1.0 / 3.0)
    for _ in range(ROUNDS):
        fitted = amounts @ shapes
        amounts = amounts * (shapes @ (count * level / fitted**2)) / (shapes @ (count / fitted))
    fitted = amounts @ shapes
    information = (shapes * (count / fitted**2)) @ shapes.T
    # A level at its bound is no unknown: it cannot hide the others.
    free = amounts > 1e-6 * np.max(amounts)
    free[2] = True
    spread = np.sqrt(inverse_normal(information[np.ix_(free, free)])[-1, -1])
    rest = size * (amounts[:2] @ shapes[:2])
    return float(amounts[2]) * size / scale, float(spread) * size / scale, rest


def _response(coordinates: Coordinates, z: FloatArray, quantity: Quantity, frequency: FloatArray) -> ComplexArray:
    return np.asarray(coordinates.model.frequency_response(coordinates.values(z), frequency, quantity), dtype=complex)


def _grid(record: Record) -> FloatArray:
    """Frequencies that stand for the whole spectrum of a sampled signal."""
    return np.arange(0.5, GRID, dtype=float) * (record.sampling_rate_hz / (2.0 * GRID))


def _slope(
    coordinates: Coordinates, z: FloatArray, quantity: Quantity, frequency: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """∂M/∂z, shape (p,), and mean ∂H* ∂H, shape (p, p), by central differences."""
    middle = _response(coordinates, z, quantity, frequency)
    columns = []
    for index in range(len(z)):
        step = np.zeros(len(z))
        step[index] = STEP
        ahead, behind = (_response(coordinates, z + sign * step, quantity, frequency) for sign in (1.0, -1.0))
        columns.append((ahead - behind) / (2.0 * STEP))
    slopes = np.stack(columns)
    count = len(frequency)
    first = np.asarray(2.0 * np.real(slopes @ np.conj(middle)) / count, dtype=float)
    return first, np.asarray(np.real(np.conj(slopes) @ slopes.T) / count, dtype=float)

"""Start values of two modes by linear algebra, from the poles of a rational function.

Where two modes overlap, no guess of the second beside the first leads to them. The ratio N(s)/D(s)
of polynomials has no such dead ends: Levy's linear equations N − H D = 0, weighted again and again
by 1/D of the last round (Sanathanan & Koerner 1963), end at the poles, which are assigned to the
modes in pairs.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from vibrident.data.records import FloatArray, Quantity
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.start.search import TargetFRF
from vibrident.physics.models import SensorModel

#: Smallest relative deviation.
MIN_DEVIATION = 1e-6


def two_modes(
    sought: TargetFRF, model: SensorModel, quantity: Quantity, known: dict[str, float]
) -> Iterator[dict[str, float]]:
    """Yield parameters of a model with a second mode whose poles fit the response.

    None where the fit has no two modes.

    Args:
        sought: the response, with its phase.
        model: linear, with two modes.
        quantity: of the reference.
        known: values of the parameters; the delay and what is no pole are taken from there.
    """
    series = _series(model, known, sought.frequency_hz)
    target = TargetFRF(
        sought.frequency_hz,
        sought.response / series,
        sought.deviation,
        sought.phase_deviation,
        True,
        sought.polar,
    )
    shape = model.rational(known, quantity)
    zeros = next(k for k, c in enumerate(shape.numerator) if np.any(np.asarray(c) != 0.0))
    poles = fitted_poles(target, len(shape.denominator) - 1, zeros, len(shape.numerator) - zeros)
    if poles is not None:
        for values in _assignments(poles, model, known):
            yield _with_gains(values, sought, model, quantity)


def fitted_poles(
    sought: TargetFRF, order: int, zeros: int, coefficients: int
) -> ComplexArray | None:
    """Return the poles of N/D, rad/s, shape (order,), or None without a finite solution.

    Args:
        sought: the response.
        order: degree of D.
        zeros: of N, at the origin.
        coefficients: of N beyond them.
    """
    unit = 2.0 * np.pi * float(np.exp(np.mean(np.log(sought.frequency_hz))))
    s = 2j * np.pi * sought.frequency_hz / unit
    powers = s[:, None] ** np.arange(order + 1)
    weight = 1.0 / (np.abs(sought.response) * np.maximum(sought.deviation, MIN_DEVIATION))
    numerator = s[:, None] ** (zeros + np.arange(coefficients))
    denominator = np.append(np.zeros(order), 1.0)
    for iteration in range(12):
        row_weight = (
            weight / np.maximum(np.abs(powers @ denominator), 1e-300) if iteration else weight
        )
        rows = (
            np.concatenate([numerator, -sought.response[:, None] * powers[:, :-1]], axis=1)
            * row_weight[:, None]
        )
        target = sought.response * powers[:, -1] * row_weight
        matrix = np.concatenate([rows.real, rows.imag])
        right_side = np.concatenate([target.real, target.imag])
        size = np.maximum(np.sqrt(np.sum(matrix**2, axis=0)), 1e-300)
        solution = np.linalg.lstsq(matrix / size, right_side, rcond=None)[0] / size
        if not np.all(np.isfinite(solution)):
            return None
        denominator = np.concatenate([solution[coefficients:], [1.0]])
    return np.asarray(np.roots(denominator[::-1]) * unit, dtype=complex)


def _series(model: SensorModel, values: dict[str, float], frequency_hz: FloatArray) -> ComplexArray:
    """Return the factors in series with the rational part: delay and average."""
    s = 2j * np.pi * frequency_hz
    factor = (
        np.exp(-s * float(model.delay_s(values)))
        if model.has_delay
        else np.ones(s.shape, dtype=complex)
    )
    for addon in model.add_ons:
        if addon.factor is not None:
            factor = factor * addon.factor(values, s)
    return factor


def _assignments(
    poles: ComplexArray, model: SensorModel, fixed: dict[str, float]
) -> Iterator[dict[str, float]]:
    """Yield natural frequencies, damping ratios and the corner of a high-pass from the poles.

    In every assignment that pairs of poles allow.
    """
    stable = -np.abs(poles.real) + 1j * poles.imag
    upper = stable[stable.imag > 0]
    real = np.sort(-stable[stable.imag == 0].real)
    (natural, damping), (natural_2, damping_2) = model.oscillators
    corner_name = next((addon.corner for addon in model.add_ons if addon.corner), "")
    corners: list[float | None] = [*real.tolist()] if corner_name else [None]
    for corner in corners:
        real_poles = real.tolist()
        if corner is not None:
            real_poles.remove(corner)
        modes = [(abs(p), -p.real / abs(p)) for p in upper]
        modes += [
            (float(np.sqrt(a * b)), (a + b) / (2.0 * np.sqrt(a * b)))
            for a, b in itertools.pairwise(real_poles[: 2 * (len(real_poles) // 2)])
            if a * b > 0
        ][::2]
        if len(modes) != 2:
            continue
        for first, second in (modes, modes[::-1]):
            values = dict(fixed)
            values[natural] = first[0] / (2.0 * np.pi)
            values[damping] = first[1]
            values[natural_2] = second[0] / (2.0 * np.pi)
            values[damping_2] = second[1]
            if corner is not None:
                values[corner_name] = corner / (2.0 * np.pi)
            yield values


def _with_gains(
    values: dict[str, float], sought: TargetFRF, model: SensorModel, quantity: Quantity
) -> dict[str, float]:
    """Return the values with gain and share of the second mode by linear least squares."""
    share = model.shares[0]
    first_mode = model.frequency_response(
        values | {model.gain_name: 1.0, share: 0.0}, sought.frequency_hz, quantity
    )
    sum_of_modes = model.frequency_response(
        values | {model.gain_name: 1.0, share: 1.0}, sought.frequency_hz, quantity
    )
    weight = 1.0 / (np.abs(sought.response) * np.maximum(sought.deviation, MIN_DEVIATION))
    columns = np.stack([first_mode, sum_of_modes - first_mode], axis=1) * weight[:, None]
    target = sought.response * weight
    gain, second = np.linalg.lstsq(
        np.concatenate([columns.real, columns.imag]),
        np.concatenate([target.real, target.imag]),
        rcond=None,
    )[0]
    gain = gain if gain != 0.0 else np.finfo(float).tiny
    return values | {model.gain_name: float(gain), share: float(second / gain)}

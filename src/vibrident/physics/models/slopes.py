"""The derivative of a sensor's frequency response with its parameters, exact to rounding.

With H = g N/D F e^{−sτ}, the derivatives of g, of the coefficients of N and D and of τ are taken by
complex step, where no difference is formed (Squire & Trapp 1998); those of the factors F are stated
with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray, Quantity
from vibrident.physics.models.sensor_model import SensorModel

STEP = 1e-100  # imaginary step, in units of the parameter: its square is nothing beside one

ComplexArray = NDArray[np.complex128]


def response_and_slopes(
    model: SensorModel,
    values: Mapping[str, Any],
    frequency_hz: FloatArray,
    quantity: Quantity = "acceleration",
) -> tuple[ComplexArray, ComplexArray]:
    """Return the frequency response and its derivatives with the parameters.

    Of a nonlinear model they are those of its linearisation for small signals.

    Args:
        model: the sensor model.
        values: of the parameters by name: numbers, or of many sensors at once, each of shape
            (sensors, 1).
        frequency_hz: shape (points,).
        quantity: what the reference is.

    Returns:
        Shapes (points,) and (parameters, points); of many sensors (sensors, points) and
        (parameters, sensors, points).
    """
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
    moved, per = _step_parameters(model, values)
    system = model.rational(moved, quantity)
    gain = _with_derivatives((system.gain,), per)
    top = _evaluate_polynomials(_with_derivatives(system.numerator, per), s)
    bottom = _evaluate_polynomials(_with_derivatives(system.denominator, per), s)
    delay = _with_derivatives((model.delay_s(moved),), per) if model.has_delay else None
    late = 1.0 if delay is None else np.exp(-s * delay[0])
    factor = 1.0 if model.has_network else model.factors(values, frequency_hz)
    behind = factor * late / bottom[0]
    response = gain[0] * (top[0] * behind)
    slopes = top[1:] * (gain[0] * behind)
    slopes -= bottom[1:] * (response / bottom[0])
    slopes += gain[1:].astype(complex) * (top[0] * behind)
    if delay is not None:
        slopes -= delay[1:] * (s * response)
    for name, slope in (
        {} if model.has_network else model.factor_slopes(values, frequency_hz)
    ).items():
        slopes[model.parameter_names.index(name)] += gain[0] * (top[0] / bottom[0]) * late * slope
    return response, slopes


def _step_parameters(
    model: SensorModel, values: Mapping[str, Any]
) -> tuple[dict[str, Any], FloatArray]:
    """Move each parameter by an imaginary step.

    Returns:
        The values by name, of shape (parameters, …, 1), and one over the steps.
    """
    names = model.parameter_names
    point = np.array([values[name] for name in names], dtype=float)
    point = point.reshape(len(names), *(point.shape[1:] or (1,)))
    steps = STEP * (np.abs(point) + (point == 0.0))
    moved = np.repeat(point[:, None].astype(complex), len(names), axis=1)
    diagonal = np.arange(len(names))
    moved[diagonal, diagonal] += 1j * steps
    return dict(zip(names, moved, strict=True)), 1.0 / steps


def _with_derivatives(coefficients: tuple[Any, ...], per: FloatArray) -> FloatArray:
    """Return coefficients and below them derivatives, shape (1 + parameters, …, coefficients)."""
    moved: ComplexArray = np.empty((*per.shape[:-1], len(coefficients)), dtype=complex)
    for index, coefficient in enumerate(coefficients):
        moved[..., index : index + 1] = coefficient
    return np.concatenate([moved.real[:1], moved.imag * per])


def _evaluate_polynomials(coefficients: FloatArray, s: ComplexArray) -> ComplexArray:
    """Return the values of polynomials at ``s``, shape (…, points).

    ``coefficients``: ascending, shape (…, coefficients).
    """
    powers = np.empty((coefficients.shape[-1], s.size), dtype=complex)
    powers[0] = 1.0
    for order in range(1, len(powers)):
        np.multiply(powers[order - 1], s, out=powers[order])
    return (coefficients @ powers.view(float)).view(complex)

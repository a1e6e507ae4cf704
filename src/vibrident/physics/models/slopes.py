"""The derivative of a sensor's frequency response with its parameters, exact to rounding.

With H = g N/D F e^{−sτ}, the derivatives of g, of the coefficients of N and D and of τ are taken by complex step, where
no difference is formed (Squire & Trapp 1998); those of the factors F are stated with them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray, Quantity
from vibrident.physics.models.base import SensorModel, polynomial

STEP = 1e-100  # imaginary step, in units of the parameter: its square is nothing beside one

ComplexArray = NDArray[np.complex128]


def response_and_slopes(
    model: SensorModel, values: Mapping[str, Any], frequency_hz: FloatArray, quantity: Quantity = "acceleration"
) -> tuple[ComplexArray, ComplexArray]:
    """Frequency response, shape (points,), and its derivatives with the parameters, shape (parameters, points).

    Args:
        model: the sensor model; of a nonlinear one, its linearisation for small signals.
        values: of the parameters by name; numbers, or of many sensors at once each of shape (sensors, 1). The shapes
            returned are then (sensors, points) and (parameters, sensors, points).
        frequency_hz: shape (points,).
        quantity: what the reference is.
    """
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
    system = model.rational(values, quantity)
    top, bottom = polynomial(system.numerator, s), polynomial(system.denominator, s)
    ratio = top / bottom
    factors = [add_on.factor(values, s) for add_on in model.add_ons if add_on.factor is not None]
    late = np.exp(-s * model.delay_s(values)) if model.has_delay else 1.0
    behind = math.prod(factors, start=late)
    response = system.gain * ratio * behind

    moved, per = _moved(model, values)
    ahead = model.rational(moved, quantity)
    d_gain, d_top, d_bottom = (_slope(c, per, s) for c in ((ahead.gain,), ahead.numerator, ahead.denominator))
    slopes = (d_gain * top + system.gain * (d_top - ratio * d_bottom)) * (behind / bottom)
    if model.has_delay:
        slopes = slopes - _slope((model.delay_s(moved),), per, s) * (s * response)
    with_factor = [add_on for add_on in model.add_ons if add_on.factor is not None]
    for index, add_on in enumerate(with_factor):
        others = math.prod(factors[:index] + factors[index + 1 :], start=system.gain * ratio * late)
        for name, slope in (add_on.factor_slopes(values, s) if add_on.factor_slopes else {}).items():
            slopes[model.parameter_names.index(name)] += others * slope
    return response, slopes


def _moved(model: SensorModel, values: Mapping[str, Any]) -> tuple[dict[str, Any], Any]:
    """Each parameter moved by its own imaginary step: values of shape (parameters, …, 1), and one over the steps."""
    names = model.parameter_names
    places = {name: np.atleast_1d(np.asarray(values[name], dtype=float)) for name in names}
    steps = np.array([STEP * (np.abs(place) + (place == 0.0)) for place in places.values()])
    moved = {name: place + np.zeros(steps.shape, dtype=complex) for name, place in places.items()}
    for index, place in enumerate(moved.values()):
        place[index] += 1j * steps[index]
    return moved, 1.0 / steps


def _slope(coefficients: tuple[Any, ...], per: FloatArray, s: ComplexArray) -> Any:
    """Derivative of a polynomial at ``s`` from its coefficients at the steps, shape (parameters, …, points or 1)."""
    moved = [np.imag(c) * per if np.iscomplexobj(c) else 0.0 for c in coefficients]
    while len(moved) > 1 and np.isscalar(moved[-1]):
        moved.pop()
    return polynomial(tuple(moved), s) if len(moved) > 1 else moved[0]

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
    model: SensorModel, values: Mapping[str, float], frequency_hz: FloatArray, quantity: Quantity = "acceleration"
) -> tuple[ComplexArray, ComplexArray]:
    """Frequency response, shape (points,), and its derivatives with the parameters, shape (parameters, points).

    ``model``: the sensor model; of a nonlinear one, its linearisation for small signals; ``frequency_hz``: shape
    (points,); ``quantity``: what the reference is.
    """
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
    system = model.rational(values, quantity)
    top, bottom = polynomial(system.numerator, s), polynomial(system.denominator, s)
    late = np.exp(-s * model.delay_s(values))
    factors = [add_on.factor(values, s) for add_on in model.add_ons if add_on.factor is not None]
    behind = math.prod(factors, start=late)
    response = system.gain * top / bottom * behind
    rows = {}
    for name in model.parameter_names:
        size = abs(values[name]) or 1.0
        moved = {**values, name: complex(values[name], STEP * size)}
        ahead = model.rational(moved, quantity)
        d_top = polynomial(tuple(_slope(c, size) for c in ahead.numerator), s)
        d_bottom = polynomial(tuple(_slope(c, size) for c in ahead.denominator), s)
        own = _slope(ahead.gain, size) * top + system.gain * (d_top - top / bottom * d_bottom)
        rows[name] = own / bottom * behind - s * _slope(model.delay_s(moved), size) * response
    with_factor = [add_on for add_on in model.add_ons if add_on.factor is not None]
    for index, add_on in enumerate(with_factor):
        others = math.prod(factors[:index] + factors[index + 1 :], start=system.gain * top / bottom * late)
        for name, slope in (add_on.factor_slopes(values, s) if add_on.factor_slopes else {}).items():
            rows[name] = rows[name] + others * slope
    return response, np.array(list(rows.values()), dtype=complex)


def _slope(value: Any, size: float) -> float:
    return float(np.imag(value)) / (STEP * size)

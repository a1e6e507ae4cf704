"""No U below the laboratory's capability, the least it may state (CMC; ILAC-P14:09/2020, 5.4).

The standard uncertainty of the sensitivity, at each frequency, is raised to half the capability
where it is smaller.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from vibrident.data.records import Capability, FloatArray
from vibrident.physics.naming import is_gain
from vibrident.result import Curve, Parameter, Result

SOURCE = "capability of the laboratory (CMC)"
_Curve = TypeVar("_Curve", bound=Curve)
Floor = Callable[[FloatArray], FloatArray]  # frequencies → least standard uncertainty at each


def with_floor(result: Result, capabilities: Sequence[Capability]) -> Result:
    """Return the result with no u of the sensitivity below half the laboratory's capability.

    Curve and measured points are raised where the capability holds. The gain, one for all
    frequencies, is raised to the least capability of the magnitude over the measured points, and
    the budget gets a row of the difference.
    """
    if not capabilities or not result.has_gain:
        return result
    stated = [
        {
            "quantity": capability.quantity,
            "U": capability.expanded_uncertainty,
            "from_hz": capability.from_hz,
            "to_hz": capability.to_hz,
        }
        for capability in capabilities
    ]

    def floor_of(quantity: str) -> Floor:
        return lambda frequency_hz: floor(capabilities, quantity, frequency_hz)

    raised_result = raised(result, floor_of("magnitude"), floor_of("phase"), SOURCE)
    measured = _raise_curve(result.measured, floor_of("magnitude"), floor_of("phase"))
    return replace(
        raised_result, measured=measured, settings={**raised_result.settings, "cmc": stated}
    )


def raised(result: Result, magnitude: Floor, phase: Floor, source: str) -> Result:
    """Return the result with no u of its gain and of its model's curve below a floor.

    Args:
        result: of an identification.
        magnitude: least relative standard uncertainty at frequencies.
        phase: least standard uncertainty at frequencies, rad.
        source: of the floor, for the row of the budget.
    """
    floors = magnitude(result.measured.frequency_hz)
    relative = float(np.min(floors)) if floors.size else 0.0
    parameters = dict(result.parameters)
    settings = dict(result.settings)
    no_contribution = {
        name: 0.0 for name, parameter in result.parameters.items() if not parameter.derived
    }
    for name, parameter in result.parameters.items():
        u_before = parameter.standard_uncertainty
        u = relative * abs(parameter.value)
        if is_gain(name) and u_before is not None and u_before < u:
            parameters[name] = _widen(parameter, u_before, u)
            added = {name: float(np.sqrt(u**2 - u_before**2))}
            row = {
                "source": source,
                "type": "B",
                "kind": "cmc",
                "standard_uncertainty": None,
                "unit": "",
                "degrees_of_freedom": None,
                "contributions": no_contribution | added,
            }
            settings["uncertainty_budget"] = [*(settings.get("uncertainty_budget") or ()), row]
    response = _raise_curve(result.response, magnitude, phase)
    return replace(result, response=response, parameters=parameters, settings=settings)


def floor(
    capabilities: Sequence[Capability], quantity: str, frequency_hz: FloatArray
) -> FloatArray:
    """Return the least standard uncertainty at each frequency, zero where no capability holds.

    It is relative, or in rad for the quantity ``phase``.
    """
    least = np.zeros(len(frequency_hz))
    for capability in capabilities:
        inside = (frequency_hz >= capability.from_hz * (1 - 1e-9)) & (
            frequency_hz <= capability.to_hz * (1 + 1e-9)
        )
        if capability.quantity == quantity:
            least[inside] = np.maximum(least[inside], capability.expanded_uncertainty / 2.0)
    return least


def _raise_curve(curve: _Curve, magnitude: Floor, phase: Floor) -> _Curve:
    """Return the curve with no u of magnitude and phase below the floors."""
    floor_of_magnitude = magnitude(curve.frequency_hz) * np.abs(curve.magnitude)
    floor_of_phase = np.rad2deg(phase(curve.frequency_hz))
    u = curve.magnitude_uncertainty
    u_phase = curve.phase_deg_uncertainty  # NaN, not known, stays so
    return replace(
        curve,
        magnitude_uncertainty=np.where(u < floor_of_magnitude, floor_of_magnitude, u),
        phase_deg_uncertainty=np.where(u_phase < floor_of_phase, floor_of_phase, u_phase),
    )


def _widen(parameter: Parameter, u_before: float, u: float) -> Parameter:
    """Return the parameter with a larger u than before, and its interval in proportion."""
    if u_before:
        low, high = (
            None if end is None else parameter.value + u / u_before * (end - parameter.value)
            for end in parameter.interval_95
        )
    else:
        low = parameter.value - 2.0 * u
        high = parameter.value + 2.0 * u
    return replace(parameter, standard_uncertainty=u, interval_95=(low, high))

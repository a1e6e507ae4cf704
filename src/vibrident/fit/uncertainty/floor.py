"""No U below what the laboratory may state: its capability (CMC; ILAC-P14:09/2020, 5.4).

The standard uncertainty of the sensitivity, at each frequency, is raised to half the capability where it is smaller.
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
    """Return the result with no u of the sensitivity below half the capability.

    Curve and measured points are raised where the capability holds; the gain, which is that of all
    frequencies, to the least capability of the magnitude over the measured points. The budget gets
    a row of what was added to it.
    """
    if not capabilities or not result.has_gain:
        return result
    stated = [
        {
            "quantity": one.quantity,
            "U": one.expanded_uncertainty,
            "from_hz": one.from_hz,
            "to_hz": one.to_hz,
        }
        for one in capabilities
    ]

    def of(quantity: str) -> Floor:
        return lambda frequency_hz: floor(capabilities, quantity, frequency_hz)

    found = raised(result, of("magnitude"), of("phase"), SOURCE)
    measured = _raised(result.measured, of("magnitude"), of("phase"))
    return replace(found, measured=measured, settings={**found.settings, "cmc": stated})


def raised(result: Result, magnitude: Floor, phase: Floor, source: str) -> Result:
    """Return the result with no u of its gain and of its model's curve below a floor.

    Args:
        result: of an identification.
        magnitude: least relative standard uncertainty at frequencies.
        phase: least standard uncertainty at frequencies, rad.
        source: of the floor, for the row of the budget.
    """
    least = magnitude(result.measured.frequency_hz)
    relative = float(np.min(least)) if least.size else 0.0
    parameters = dict(result.parameters)
    settings = dict(result.settings)
    none = {name: 0.0 for name, each in result.parameters.items() if not each.derived}
    for name, one in result.parameters.items():
        own = one.standard_uncertainty
        u = relative * abs(one.value)
        if is_gain(name) and own is not None and own < u:
            parameters[name] = _widened(one, own, u)
            row = {
                "source": source,
                "type": "B",
                "kind": "cmc",
                "standard_uncertainty": None,
                "unit": "",
            }
            added = {name: float(np.sqrt(u**2 - own**2))}
            row |= {"degrees_of_freedom": None, "contributions": none | added}
            settings["uncertainty_budget"] = [*(settings.get("uncertainty_budget") or ()), row]
    response = _raised(result.response, magnitude, phase)
    return replace(result, response=response, parameters=parameters, settings=settings)


def floor(
    capabilities: Sequence[Capability], quantity: str, frequency_hz: FloatArray
) -> FloatArray:
    """Least standard uncertainty at each frequency, relative or in rad; zero where no capability holds."""
    least = np.zeros(len(frequency_hz))
    for one in capabilities:
        inside = (frequency_hz >= one.from_hz * (1 - 1e-9)) & (
            frequency_hz <= one.to_hz * (1 + 1e-9)
        )
        if one.quantity == quantity:
            least = np.where(inside, np.maximum(least, one.expanded_uncertainty / 2.0), least)
    return least


def _raised(curve: _Curve, magnitude: Floor, phase: Floor) -> _Curve:
    size = magnitude(curve.frequency_hz) * np.abs(curve.magnitude)
    turn = np.rad2deg(phase(curve.frequency_hz))
    u = curve.magnitude_uncertainty
    u_phase = curve.phase_deg_uncertainty  # NaN, not known, stays so
    return replace(
        curve,
        magnitude_uncertainty=np.where(u < size, size, u),
        phase_deg_uncertainty=np.where(u_phase < turn, turn, u_phase),
    )


def _widened(one: Parameter, own: float, u: float) -> Parameter:
    """The parameter with a larger u than its own, and its interval in proportion."""
    if own:
        low, high = (
            None if end is None else one.value + u / own * (end - one.value)
            for end in one.interval_95
        )
    else:
        low = one.value - 2.0 * u
        high = one.value + 2.0 * u
    return replace(one, standard_uncertainty=u, interval_95=(low, high))

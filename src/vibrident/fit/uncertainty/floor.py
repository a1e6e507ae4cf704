"""No U below what the laboratory may state: its capability (CMC; ILAC-P14:09/2020, 5.4).

The standard uncertainty of the sensitivity, at each frequency, is raised to half the capability where it is smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from vibrident.data.records import Capability, FloatArray
from vibrident.physics.naming import is_gain
from vibrident.result import Curve, Parameter, Result

SOURCE = "capability of the laboratory (CMC)"
_Curve = TypeVar("_Curve", bound=Curve)


def with_floor(result: Result, capabilities: Sequence[Capability]) -> Result:
    """The result with no u of the sensitivity below half the capability.

    Curve and measured points are raised where the capability holds; the gain, which is that of all frequencies, to the
    least capability of the magnitude over the measured points. The budget gets a row of what was added to it.
    """
    if not capabilities or not result.has_gain:
        return result
    least = floor(capabilities, "magnitude", result.measured.frequency_hz)
    relative = float(np.min(least)) if least.size else 0.0
    stated = [
        {"quantity": one.quantity, "U": one.expanded_uncertainty, "from_hz": one.from_hz, "to_hz": one.to_hz}
        for one in capabilities
    ]
    parameters, settings = dict(result.parameters), {**result.settings, "cmc": stated}
    for name, one in result.parameters.items():
        own, u = one.standard_uncertainty, relative * abs(one.value)
        if is_gain(name) and own is not None and own < u:
            parameters[name] = _widened(one, own, u)
            row = {"source": SOURCE, "type": "B", "kind": "cmc", "standard_uncertainty": None, "unit": ""}
            row |= {"degrees_of_freedom": None, "contributions": {name: float(np.sqrt(u**2 - own**2))}}
            settings["uncertainty_budget"] = [*(settings.get("uncertainty_budget") or ()), row]
    raised = {"response": _raised(result.response, capabilities), "measured": _raised(result.measured, capabilities)}
    return replace(result, **raised, parameters=parameters, settings=settings)


def floor(capabilities: Sequence[Capability], quantity: str, frequency_hz: FloatArray) -> FloatArray:
    """Least standard uncertainty at each frequency, relative or in rad; zero where no capability holds."""
    least = np.zeros(len(frequency_hz))
    for one in capabilities:
        inside = (frequency_hz >= one.from_hz * (1 - 1e-9)) & (frequency_hz <= one.to_hz * (1 + 1e-9))
        if one.quantity == quantity:
            least = np.where(inside, np.maximum(least, one.expanded_uncertainty / 2.0), least)
    return least


def _raised(curve: _Curve, capabilities: Sequence[Capability]) -> _Curve:
    f = curve.frequency_hz
    size = floor(capabilities, "magnitude", f) * np.abs(curve.magnitude)
    turn = np.rad2deg(floor(capabilities, "phase", f))
    magnitude, phase = curve.magnitude_uncertainty, curve.phase_deg_uncertainty  # NaN, not known, stays so
    return replace(
        curve,
        magnitude_uncertainty=np.where(magnitude < size, size, magnitude),
        phase_deg_uncertainty=np.where(phase < turn, turn, phase),
    )


def _widened(one: Parameter, own: float, u: float) -> Parameter:
    """The parameter with a larger u than its own, and its interval in proportion."""
    if own:
        low, high = (None if end is None else one.value + u / own * (end - one.value) for end in one.interval_95)
    else:
        low, high = one.value - 2.0 * u, one.value + 2.0 * u
    return replace(one, standard_uncertainty=u, interval_95=(low, high))

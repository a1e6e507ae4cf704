"""No U below what the laboratory may state: its capability (CMC; ILAC-P14:09/2020, 5.4).

The standard uncertainty of the sensitivity, at each frequency, is raised to half the capability where it is smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from vibrident.data.records import Capability, FloatArray
from vibrident.physics.naming import is_gain
from vibrident.result import Curve, Parameter, Result

SOURCE = "capability of the laboratory (CMC)"
_K = 2.0  # coverage factor of a capability
_Curve = TypeVar("_Curve", bound=Curve)


def with_floor(result: Result, capabilities: Sequence[Capability]) -> Result:
    """The result with no u of the sensitivity below half the capability.

    Curve and measured points are raised where the capability holds; the gain, which is that of all frequencies, to the
    least capability of the magnitude over the measured points. The budget gets a row of what was added to it.
    """
    if not capabilities or not result.has_gain:
        return result
    curves = [_raised(curve, capabilities) for curve in (result.response, result.measured)]
    least = floor(capabilities, "magnitude", result.measured.frequency_hz)
    relative = float(np.min(least)) if least.size else 0.0
    parameters, settings = dict(result.parameters), dict(result.settings)
    stated = [
        {"quantity": one.quantity, "U": one.expanded_uncertainty, "from_hz": one.from_hz, "to_hz": one.to_hz}
        for one in capabilities
    ]
    settings["cmc"] = stated
    for name, one in result.parameters.items():
        if (
            is_gain(name)
            and one.standard_uncertainty is not None
            and one.standard_uncertainty < relative * abs(one.value)
        ):
            u = relative * abs(one.value)
            parameters[name] = _widened(one, u)
            settings["uncertainty_budget"] = [
                *_rows(settings),
                _row(name, float(np.sqrt(u**2 - one.standard_uncertainty**2))),
            ]
    return replace(result, response=curves[0], measured=curves[1], parameters=parameters, settings=settings)


def floor(capabilities: Sequence[Capability], quantity: str, frequency_hz: FloatArray) -> FloatArray:
    """Least standard uncertainty at each frequency, relative or in rad; zero where no capability holds."""
    least = np.zeros(len(frequency_hz))
    for one in capabilities:
        inside = (frequency_hz >= one.from_hz * (1 - 1e-9)) & (frequency_hz <= one.to_hz * (1 + 1e-9))
        if one.quantity == quantity:
            least = np.where(inside, np.maximum(least, one.expanded_uncertainty / _K), least)
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


def _widened(one: Parameter, u: float) -> Parameter:
    """The parameter with a larger u, and its interval in proportion."""
    share = u / one.standard_uncertainty if one.standard_uncertainty else 1.0
    low, high = one.interval_95
    if one.standard_uncertainty:
        ends = (None if end is None else one.value + share * (end - one.value) for end in (low, high))
        low, high = ends
    else:
        low, high = one.value - _K * u, one.value + _K * u
    return replace(one, standard_uncertainty=u, interval_95=(low, high))


def _rows(settings: dict[str, Any]) -> list[Any]:
    return list(settings.get("uncertainty_budget") or ())


def _row(name: str, u: float) -> dict[str, Any]:
    own = {"source": SOURCE, "type": "B", "kind": "cmc", "standard_uncertainty": None, "unit": ""}
    return {**own, "degrees_of_freedom": None, "contributions": {name: u}}

"""Which label goes to which pole: parameters that give exactly the same response, and the rule that chooses among them.

The response does not say which of two modes is the first, nor which of three real poles belongs to a high-pass. Every
estimate is brought to one form:

- ``mode2``: the main mode is the one with the larger share of the static response, |mode2_gain| ≤ 1. Exchanged, the
  modes swap frequency and damping, the gain becomes gain · mode2_gain and the share its inverse. (The modes of an
  accelerometer only: those of a velocity pickup are no equals, its first one vanishes at low frequency.)
- ``highpass`` behind an overdamped sensor (δ > 1, two real poles): the lowest pole is the high-pass's. A pole p of the
  sensor for the corner c: ωn'² = c q with q the other pole, δ' = (c + q)/(2 ωn'), gain · ωn²/ωn'² for an accelerometer.
- Damping ratios are not negative.

Beside a second mode the poles of a high-pass cannot be exchanged: the numerator would not fit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from vibrident.models.base import SensorModel
from vibrident.records import FloatArray

#: Takes and gives values by name, real or complex; analytic.
Relabelling = Callable[[Mapping[str, Any]], dict[str, Any]]

#: Add-ons that change nothing of who is who.
_IN_SERIES = {"delay", "boxcar"}
#: Step of the complex-step derivative: no difference is taken, so nothing is lost.
_STEP = 1e-30


def relabellings(model: SensorModel, values: Mapping[str, float]) -> tuple[Relabelling, ...]:
    """Every other way to name the poles of a sensor that leaves its response as it is."""
    names = {addon.name for addon in model.add_ons}
    accelerometer = model.core.name == "accelerometer"
    if not names <= _IN_SERIES | {"mode2", "highpass"}:
        return ()
    if "mode2" in names:
        return (_modes_exchanged(model.gain_name),) if accelerometer and values["mode2_gain"] != 0.0 else ()
    if "highpass" in names and values["damping_ratio"] > 1.0:
        gain = model.gain_name if accelerometer else None
        return _corner_exchanged(-1.0, gain), _corner_exchanged(1.0, gain)
    return ()


def _modes_exchanged(gain: str) -> Relabelling:
    def exchange(values: Mapping[str, Any]) -> dict[str, Any]:
        return dict(values) | {
            gain: values[gain] * values["mode2_gain"],
            "natural_frequency": values["mode2_frequency"],
            "damping_ratio": values["mode2_damping"],
            "mode2_frequency": values["natural_frequency"],
            "mode2_damping": values["damping_ratio"],
            "mode2_gain": 1.0 / values["mode2_gain"],
        }

    return exchange


def _corner_exchanged(side: float, gain: str | None) -> Relabelling:
    """The corner for the sensor's lower (``side`` −1) or upper real pole."""

    def exchange(values: Mapping[str, Any]) -> dict[str, Any]:
        natural, damping, corner = (values[n] for n in ("natural_frequency", "damping_ratio", "highpass_frequency"))
        root = (damping * damping - 1.0) ** 0.5
        mine, other = natural * (damping + side * root), natural * (damping - side * root)
        now = (corner * other) ** 0.5
        found = dict(values) | {
            "natural_frequency": now,
            "damping_ratio": (corner + other) / (2.0 * now),
            "highpass_frequency": mine,
        }
        if gain is not None:
            found[gain] = values[gain] * (natural / now) ** 2
        return found

    return exchange


def rule(model: SensorModel, values: Mapping[str, float]) -> Relabelling | None:
    """The relabelling that brings these values to the one form; None where they have it."""
    others = relabellings(model, values)
    if not others:
        return None
    if "mode2_gain" in values:
        share = abs(values["mode2_gain"])
        lower = values["mode2_frequency"] < values["natural_frequency"]
        return others[0] if share > 1.0 or (share == 1.0 and lower) else None
    lowest = others[0](values)["highpass_frequency"]
    return others[0] if lowest < values["highpass_frequency"] else None


def canonical(model: SensorModel, values: Mapping[str, float]) -> dict[str, float]:
    """The values in the one form."""
    found = upright(model, values)
    change = rule(model, found)
    return found if change is None else {name: float(value) for name, value in change(found).items()}


def upright(model: SensorModel, values: Mapping[str, float]) -> dict[str, float]:
    """The values with damping ratios that are not negative."""
    positive = {spec.name for spec in model.parameters if spec.kind == "positive"}
    return {name: abs(value) if name in positive else value for name, value in values.items()}


def slopes(model: SensorModel, change: Relabelling, values: Mapping[str, float]) -> FloatArray:
    """∂(new values)/∂(values) of a relabelling, exact to rounding, shape (p, p), in the model's order."""
    names = model.parameter_names
    found = np.empty((len(names), len(names)))
    for column, name in enumerate(names):
        moved = change({**values, name: complex(values[name], _STEP)})
        found[:, column] = [complex(moved[row]).imag / _STEP for row in names]
    return found

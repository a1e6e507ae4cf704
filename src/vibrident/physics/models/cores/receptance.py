"""Receptance of a structure: displacement per force, of one mode (ISO 7626-1: dynamic compliance).

    m ẍ + c ẋ + k x = F,   x/F = (1/k) ωn²/(s² + 2 δ ωn s + ωn²)

A hammer or an exciter with a force sensor gives F in N. The gain is the static compliance 1/k of
the mode; modal mass m = k/ωn² and damping coefficient c = 2 δ k/ωn follow.
At a point that is not
driven the gain may have either sign, and k, m and c are those of the mode between the two points.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.physics.models.base import (
    ANGULAR_FREQUENCY,
    DAMPING_RATIO,
    NATURAL_FREQUENCY,
    OSCILLATOR,
    Derived,
    Parameters,
    ParameterSpec,
    has_peak,
)
from vibrident.physics.models.model import Model

COMPLIANCE = ParameterSpec("compliance", "m/N", "gain", words="static compliance", symbol="C")
FORCED = (COMPLIANCE, NATURAL_FREQUENCY, DAMPING_RATIO)


def response(s: Any, compliance: Any, natural_frequency: Any, damping_ratio: Any) -> Any:
    """Return the displacement per force."""
    wn = 2.0 * np.pi * natural_frequency
    return compliance * (wn * wn) / (s**2 + 2.0 * damping_ratio * wn * s + wn * wn)


def _mass(parameters: Parameters) -> Any:
    return 1.0 / (parameters["compliance"] * ANGULAR_FREQUENCY.value(parameters) ** 2)


def _damping(parameters: Parameters) -> Any:
    """Return c = 2 δ k/ωn."""
    return (
        2.0
        * parameters["damping_ratio"]
        / (parameters["compliance"] * ANGULAR_FREQUENCY.value(parameters))
    )


#: Of a mode: what its equation of motion is made of.
MODAL = (
    ANGULAR_FREQUENCY,
    Derived("modal_stiffness", "N/m", lambda p: 1.0 / p["compliance"], symbol="k", positive=False),
    Derived("modal_mass", "kg", _mass, symbol="m", needs=OSCILLATOR[:1], positive=False),
    Derived("damping_coefficient", "N s/m", _damping, symbol="c", needs=OSCILLATOR, positive=False),
)

RECEPTANCE = Model(
    name="receptance",
    title="receptance of a structure (displacement per force, one mode)",
    parameters=FORCED,
    response=response,
    derived=(
        *MODAL,
        Derived(
            "resonance_frequency",
            "Hz",
            lambda p: p["natural_frequency"] * (1.0 - 2.0 * p["damping_ratio"] ** 2) ** 0.5,
            has_peak,
            symbol="f0",
            needs=OSCILLATOR,
        ),
    ),
    oscillator=OSCILLATOR,
    output="displacement",
    behind="force",
    response_unit="m",
)

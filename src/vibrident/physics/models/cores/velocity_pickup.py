"""Electrodynamic velocity pickup: a coil on the mass in a magnet's field, V = G ẋ.

With ẍ + 2 δ ωn ẋ + ωn² x = a (x: displacement of the case against the mass, PAPER eq. 1),

    V/a = G s / (s² + 2 δ ωn s + ωn²),   V/v = G s² / (s² + 2 δ ωn s + ωn²).

Geophones and electrodynamic seismometers; G is the generator constant (V per m/s, signed).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.physics.models.base import (
    ANGULAR_FREQUENCY,
    DAMPING_RATIO,
    NATURAL_FREQUENCY,
    OSCILLATOR,
    Core,
    Derived,
    Parameters,
    ParameterSpec,
    Rational,
    has_peak,
)


def _rational(parameters: Parameters) -> Rational:
    wn = 2.0 * np.pi * parameters["natural_frequency"]
    damping = parameters["damping_ratio"]
    return Rational(parameters["generator_constant"], (0.0, 1.0), (wn * wn, 2.0 * damping * wn, 1.0), wn)


def _resonance(parameters: Parameters) -> Any:
    """Frequency of the largest |V/v|, the high-pass counterpart of an accelerometer's: fn/√(1 − 2 δ²)."""
    return parameters["natural_frequency"] / (1.0 - 2.0 * parameters["damping_ratio"] ** 2) ** 0.5


VELOCITY_PICKUP = Core(
    name="velocity-pickup",
    title="velocity pickup (electrodynamic coil, second order)",
    parameters=(
        ParameterSpec("generator_constant", "{response}/({reference_integrated})", "gain", symbol="G"),
        NATURAL_FREQUENCY,
        DAMPING_RATIO,
    ),
    rational=_rational,
    derived=(
        ANGULAR_FREQUENCY,
        Derived("resonance_frequency", "Hz", _resonance, has_peak, symbol="f0", needs=OSCILLATOR),
    ),
    oscillator=OSCILLATOR,
    output="velocity",
)

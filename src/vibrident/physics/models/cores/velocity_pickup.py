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
    Derived,
    Parameters,
    ParameterSpec,
    has_peak,
)
from vibrident.physics.models.model import Model


def _response(s: Any, generator_constant: Any, natural_frequency: Any, damping_ratio: Any) -> Any:
    wn = 2.0 * np.pi * natural_frequency
    return generator_constant * s / (s**2 + 2.0 * damping_ratio * wn * s + wn * wn)


def _resonance(parameters: Parameters) -> Any:
    """Return the frequency of the largest |V/v|, fn/√(1 − 2 δ²).

    It is the high-pass counterpart of an accelerometer's.
    """
    return parameters["natural_frequency"] / (1.0 - 2.0 * parameters["damping_ratio"] ** 2) ** 0.5


VELOCITY_PICKUP = Model(
    name="velocity-pickup",
    title="velocity pickup (electrodynamic coil, second order)",
    parameters=(
        ParameterSpec(
            "generator_constant", "{response}/({reference_integrated})", "gain", symbol="G"
        ),
        NATURAL_FREQUENCY,
        DAMPING_RATIO,
    ),
    response=_response,
    derived=(
        ANGULAR_FREQUENCY,
        Derived("resonance_frequency", "Hz", _resonance, has_peak, symbol="f0", needs=OSCILLATOR),
    ),
    oscillator=OSCILLATOR,
    output="velocity",
    behind="motion",
)

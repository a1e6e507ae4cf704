"""Displacement pickup: a damped mass on a spring whose displacement is turned into voltage.

    V̈ + 2 δ ωn V̇ + ωn² V = K a,   K = S0 ωn²            (Li et al. 2025, eqs. 1–3)

Piezoelectric, capacitive and MEMS accelerometers below their electronics' limits, and any sensor
whose output follows the displacement of its mass (a laser on a seismometer's mass, say).
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


def _response(s: Any, sensitivity: Any, natural_frequency: Any, damping_ratio: Any) -> Any:
    wn = 2.0 * np.pi * natural_frequency
    return sensitivity * (wn * wn) / (s**2 + 2.0 * damping_ratio * wn * s + wn * wn)


def _resonance(parameters: Parameters) -> Any:
    """Return the frequency of the largest |V/a|; there is no peak for δ ≥ 1/√2 (eq. 3)."""
    return parameters["natural_frequency"] * (1.0 - 2.0 * parameters["damping_ratio"] ** 2) ** 0.5


ACCELEROMETER = Model(
    name="accelerometer",
    title="accelerometer (displacement pickup, second order)",
    parameters=(
        ParameterSpec("sensitivity", "{response}/({reference})", "gain", symbol="S0"),
        NATURAL_FREQUENCY,
        DAMPING_RATIO,
    ),
    response=_response,
    derived=(
        ANGULAR_FREQUENCY,
        Derived("resonance_frequency", "Hz", _resonance, has_peak, symbol="f0", needs=OSCILLATOR),
        Derived(
            "conversion_coefficient",
            "{conversion}",
            lambda p: p["sensitivity"] * ANGULAR_FREQUENCY.value(p) ** 2,
            symbol="K",
            needs=OSCILLATOR[:1],
            positive=False,
        ),
    ),
    oscillator=OSCILLATOR,
    output="displacement",
    behind="motion",
)

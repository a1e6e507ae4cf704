"""Displacement pickup: a damped mass on a spring whose displacement is turned into voltage.

    V̈ + 2 δ ωn V̇ + ωn² V = K a,   K = S0 ωn²            (PAPER eqs. 1–3; Li et al. 2025)

Piezoelectric, capacitive and MEMS accelerometers below their electronics' limits, and any sensor whose output
follows the displacement of its mass (a laser on a seismometer's mass, say).
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
    return Rational(parameters["sensitivity"], (wn * wn,), (wn * wn, 2.0 * damping * wn, 1.0), wn)


def _resonance(parameters: Parameters) -> Any:
    """Frequency of the largest |V/a|; there is no peak for δ ≥ 1/√2 (eq. 3)."""
    return parameters["natural_frequency"] * (1.0 - 2.0 * parameters["damping_ratio"] ** 2) ** 0.5


ACCELEROMETER = Core(
    name="accelerometer",
    title="accelerometer (displacement pickup, second order)",
    parameters=(
        ParameterSpec("sensitivity", "{response}/({reference})", "gain", symbol="S0"),
        NATURAL_FREQUENCY,
        DAMPING_RATIO,
    ),
    rational=_rational,
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
)

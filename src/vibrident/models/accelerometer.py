"""Displacement pickup: a damped mass on a spring whose displacement is turned into voltage.

    V̈ + 2 δ ωn V̇ + ωn² V = K a,   K = S0 ωn²            (PAPER eqs. 1–3; Li et al. 2025)

Piezoelectric, capacitive and MEMS accelerometers below their electronics' limits, and any sensor whose output
follows the displacement of its mass (a laser on a seismometer's mass, say).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.models.base import Core, Parameters, ParameterSpec, Rational


def _rational(parameters: Parameters) -> Rational:
    wn = 2.0 * np.pi * parameters["natural_frequency"]
    damping = parameters["damping_ratio"]
    return Rational(parameters["sensitivity"], (wn * wn,), (wn * wn, 2.0 * damping * wn, 1.0), wn)


def _derived(parameters: Parameters) -> dict[str, tuple[Any, str]]:
    fn, damping = parameters["natural_frequency"], parameters["damping_ratio"]
    wn = 2.0 * np.pi * fn
    derived = {
        "natural_angular_frequency": (wn, "rad/s"),
        "conversion_coefficient": (parameters["sensitivity"] * wn * wn, "{response}/m"),
    }
    if 2.0 * damping * damping < 1.0:
        # Frequency of the largest |V/a|; there is no peak for δ ≥ 1/√2 (eq. 3).
        derived["resonance_frequency"] = (fn * (1.0 - 2.0 * damping * damping) ** 0.5, "Hz")
    return derived


ACCELEROMETER = Core(
    name="accelerometer",
    title="accelerometer (displacement pickup, second order)",
    parameters=(
        ParameterSpec("sensitivity", "{response}/({reference})", "gain"),
        ParameterSpec("natural_frequency", "Hz", "log"),
        ParameterSpec("damping_ratio", "1", "positive"),
    ),
    rational=_rational,
    derived=_derived,
)

"""Accelerance of a structure: acceleration per force, of one mode (ISO 7626-1).

It is −ω² times the receptance, with the same parameters; far above ωn it is one over the modal
mass.
"""

from __future__ import annotations

from vibrident.physics.models.base import OSCILLATOR, Derived, has_peak
from vibrident.physics.models.cores.receptance import FORCED, MODAL, response
from vibrident.physics.models.model import Model

ACCELERANCE = Model(
    name="accelerance",
    title="accelerance of a structure (acceleration per force, one mode)",
    parameters=FORCED,
    response=response,
    derived=(
        *MODAL,
        Derived(
            "resonance_frequency",
            "Hz",
            lambda p: p["natural_frequency"] / (1.0 - 2.0 * p["damping_ratio"] ** 2) ** 0.5,
            has_peak,
            symbol="f0",
            needs=OSCILLATOR,
        ),
    ),
    oscillator=OSCILLATOR,
    output="displacement",
    derivative=2,
    behind="force",
    response_unit="m/s^2",
)

"""Convective accelerometer: a bubble of heated gas moves, with a first-order lag.

V/a = S0 / (1 + s/ωc),   ωc = 2π fc
"""

from __future__ import annotations

import numpy as np

from vibrident.physics.models import Derived, Model, ParameterSpec

CONVECTIVE = Model(
    "convective",
    lambda s, sensitivity, cutoff_frequency: sensitivity / (1 + s / (2 * np.pi * cutoff_frequency)),
    [
        ParameterSpec("sensitivity", "{response}/({reference})", symbol="S0"),
        ParameterSpec(
            "cutoff_frequency", "Hz", words="cut-off frequency", symbol="fc", describes="oscillator"
        ),
    ],
    title="convective accelerometer (first order)",
    derived=(
        Derived(
            "thermal_time_constant",
            "s",
            lambda values: 1.0 / (2.0 * np.pi * values["cutoff_frequency"]),
            symbol="Tc",
            needs=("cutoff_frequency",),
        ),
    ),
)

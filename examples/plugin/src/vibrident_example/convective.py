"""Convective accelerometer: a bubble of heated gas is displaced, and follows with a first-order lag.

V/a = S0 / (1 + s/ωc),   ωc = 2π fc
"""

from __future__ import annotations

import numpy as np

from vibrident.physics.models import Core, Derived, ParameterSpec, Rational


def _rational(values):
    rate = 2.0 * np.pi * values["cutoff_frequency"]
    return Rational(values["sensitivity"], (rate,), (rate, 1.0), rate)


CONVECTIVE = Core(
    name="convective",
    title="convective accelerometer (first order)",
    parameters=(
        ParameterSpec("sensitivity", "{response}/({reference})", "gain", symbol="S0"),
        ParameterSpec(
            "cutoff_frequency",
            "Hz",
            "log",
            words="cut-off frequency",
            symbol="fc",
            describes="oscillator",
            grid="band",
        ),
    ),
    rational=_rational,
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

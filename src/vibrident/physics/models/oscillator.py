"""Parameters of the damped oscillator, as any core has them that is one: fn, δ, and what follows from them."""

from __future__ import annotations

import numpy as np

from vibrident.physics.models.base import Derived, Parameters, ParameterSpec

OSCILLATOR = ("natural_frequency", "damping_ratio")  # names of natural frequency and damping ratio
_DAMPINGS = (0.0005, 0.003, 0.02, 0.08, 0.2, 0.4, 0.6, 0.8, 1.2, 2.5)  # from which start values are looked for

NATURAL_FREQUENCY = ParameterSpec(OSCILLATOR[0], "Hz", "log", symbol="fn", describes="oscillator", grid="band")
DAMPING_RATIO = ParameterSpec(OSCILLATOR[1], "1", "positive", symbol="δ", describes="oscillator", grid=_DAMPINGS)
ANGULAR_FREQUENCY = Derived(
    "natural_angular_frequency",
    "rad/s",
    lambda parameters: 2.0 * np.pi * parameters[OSCILLATOR[0]],
    symbol="ωn",
    needs=OSCILLATOR[:1],
)


def has_peak(parameters: Parameters) -> bool:
    """Whether the response has a maximum: δ < 1/√2."""
    return 2.0 * parameters[OSCILLATOR[1]] ** 2 < 1.0

"""A gain: the sensitivity at the one frequency that was measured, and nothing about any other.

    V = S0 a

A handheld calibrator moves a sensor with one sine (159.155 Hz, ω = 1000 rad/s). With a delay, which
stands for the phase there, the gain is what was measured.
"""

from __future__ import annotations

from vibrident.physics.models.base import ParameterSpec
from vibrident.physics.models.model import Model

GAIN = Model(
    name="gain",
    title="gain (the sensitivity at one frequency)",
    parameters=(ParameterSpec("sensitivity", "{response}/({reference})", "gain", symbol="S0"),),
    response=lambda s, sensitivity: sensitivity,
)

"""A gain: the sensitivity at the one frequency that was measured, and nothing about any other.

    V = S0 a

A handheld calibrator moves a sensor with one sine (159.155 Hz, ω = 1000 rad/s). With a delay, which
stands for the phase there, the gain is what was measured.
"""

from __future__ import annotations

from vibrident.physics.models.base import Core, Parameters, ParameterSpec, Rational

#: Pole and zero at −100 rad/s cancel at every frequency: the network has a state, which its output
#: does not hold. It decays within a record of a second, and not within a sample of a slow one.
_CANCELLED = 100.0


def _rational(parameters: Parameters) -> Rational:
    both = (_CANCELLED, 1.0)
    return Rational(parameters["sensitivity"], both, both, _CANCELLED)


GAIN = Core(
    name="gain",
    title="gain (the sensitivity at one frequency)",
    parameters=(ParameterSpec("sensitivity", "{response}/({reference})", "gain", symbol="S0"),),
    rational=_rational,
)

"""First-order high-pass behind the sensor, as a charge amplifier or an AC-coupled input has: s/(s + 2π fh)."""

from __future__ import annotations

import numpy as np

from vibrident.models.base import AddOn, Parameters, ParameterSpec, Rational


def _rational(parameters: Parameters, system: Rational) -> Rational:
    corner = 2.0 * np.pi * parameters["highpass_frequency"]
    low = system.denominator
    product = [corner * low[0]]
    product += [corner * low[k] + low[k - 1] for k in range(1, len(low))]
    return Rational(system.gain, (0.0, *system.numerator), (*product, low[-1]), system.angular_scale)


HIGHPASS = AddOn(
    name="highpass",
    title="first-order high-pass",
    parameters=(ParameterSpec("highpass_frequency", "Hz", "log", guesses=(0.03, 0.3, 3.0, 30.0), guess_at="lowest"),),
    rational=_rational,
)

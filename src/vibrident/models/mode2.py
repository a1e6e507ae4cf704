"""A second mode beside the first, such as a mounting resonance.

    gain · [N(s)/D(s) + g₂ ω₂²/(s² + 2 δ₂ ω₂ s + ω₂²)]

g₂ is the second mode's share of the response at low frequency, of either sign.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.models.base import AddOn, Parameters, ParameterSpec, Rational


def _rational(parameters: Parameters, system: Rational) -> Rational:
    w2 = 2.0 * np.pi * parameters["mode2_frequency"]
    second = (w2 * w2, 2.0 * parameters["mode2_damping"] * w2, 1.0)
    share = parameters["mode2_gain"] * w2 * w2
    numerator = _sum(_product(system.numerator, second), tuple(share * c for c in system.denominator))
    return Rational(system.gain, numerator, _product(system.denominator, second), system.angular_scale)


def _product(one: tuple[Any, ...], other: tuple[Any, ...]) -> tuple[Any, ...]:
    """Product of two polynomials, ascending coefficients."""
    total: list[Any] = [0.0] * (len(one) + len(other) - 1)
    for i, a in enumerate(one):
        for j, b in enumerate(other):
            total[i + j] = total[i + j] + a * b
    return tuple(total)


def _sum(one: tuple[Any, ...], other: tuple[Any, ...]) -> tuple[Any, ...]:
    size = max(len(one), len(other))
    padded = [p + (0.0,) * (size - len(p)) for p in (one, other)]
    return tuple(a + b for a, b in zip(*padded, strict=True))


MODE2 = AddOn(
    name="mode2",
    title="second mode",
    parameters=(
        ParameterSpec(
            "mode2_frequency", "Hz", "log", guesses=tuple(np.linspace(-0.1, 1.2, 53).tolist()), guess_at="band"
        ),
        ParameterSpec("mode2_damping", "1", "positive", guesses=(0.01, 0.05), guess_at="one"),
        ParameterSpec("mode2_gain", "1", "ratio", guesses=(-0.2, -0.02, 0.02, 0.2), guess_at="one"),
    ),
    rational=_rational,
)

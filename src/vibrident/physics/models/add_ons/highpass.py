"""First-order high-pass behind the sensor, as a charge amplifier or an AC-coupled input has.

Its factor is s/(s + 2π fh). Behind an overdamped sensor (δ > 1, two real poles) the response does
not say which of three real poles is the high-pass's: the lowest is. A pole p of the sensor for the
corner c: ωn'² = c q with q the other pole, δ' = (c + q)/(2 ωn'), and the gain times ωn²/ωn'² where
it is the static one. Beside a second mode the poles cannot be exchanged: the numerator would not
fit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.physics.models.base import (
    AddOn,
    Labels,
    Parameters,
    ParameterSpec,
    Rational,
    Relabelling,
    Values,
)
from vibrident.physics.models.model import Model
from vibrident.physics.models.ratio import product


def _rational(parameters: Parameters, system: Rational) -> Rational:
    """Return a system with the high-pass in series."""
    corner = 2.0 * np.pi * parameters[_CORNER]
    denominator = product((corner, 1.0), system.denominator)
    return replace(system, numerator=(0.0, *system.numerator), denominator=denominator)


_CORNER = "highpass_frequency"
_QUESTION = "which of its three real poles is the high-pass's; the lowest was taken"


def _alternatives(core: Model, values: Values) -> tuple[Relabelling, ...]:
    """Return the exchanges of the high-pass's pole for each real pole of the sensor."""
    if core.oscillator is None or core.output == "other" or not values[core.oscillator[1]] > 1.0:
        return ()
    return _exchanged(core, -1.0), _exchanged(core, 1.0)


def _exchanged(core: Model, side: float) -> Relabelling:
    """Return the corner for the sensor's lower (``side`` −1) or upper real pole."""
    assert core.oscillator is not None
    frequency, ratio = core.oscillator
    gain = core.parameters[0].name if core.output == "displacement" else None

    def exchange(values: Values) -> dict[str, Any]:
        natural, damping, corner = (values[name] for name in (frequency, ratio, _CORNER))
        # δ − √(δ² − 1) is one over it, and loses its digits.
        ratio_up = damping + (damping * damping - 1.0) ** 0.5
        upper = natural * ratio_up
        lower = natural / ratio_up
        new_corner, remaining = (upper, lower) if side > 0.0 else (lower, upper)
        new_natural = (corner * remaining) ** 0.5
        exchanged = dict(values) | {
            frequency: new_natural,
            ratio: (corner + remaining) / (2.0 * new_natural),
            _CORNER: new_corner,
        }
        if gain is not None:
            exchanged[gain] = values[gain] * (natural / new_natural) ** 2
        return exchanged

    return exchange


HIGHPASS = AddOn(
    name="highpass",
    title="first-order high-pass",
    parameters=(
        ParameterSpec(
            _CORNER,
            "Hz",
            "log",
            guesses=(0.03, 0.3, 3.0, 30.0),
            guess_at="lowest",
            words="high-pass frequency",
            symbol="fhp",
        ),
    ),
    rational=_rational,
    corner=_CORNER,
    labels=Labels(
        _alternatives,
        lambda values, alternative: alternative[_CORNER] >= values[_CORNER],
        lambda values, u: True,
        _QUESTION,
    ),
)

"""A second mode beside the first, such as a mounting resonance.

    gain · [N(s)/D(s) + g₂ ω₂²/(s² + 2 δ₂ ω₂ s + ω₂²)]

g₂ is the second mode's share of the response at low frequency, of either sign.

The response does not determine which of two modes is the first. By convention the first has the
larger share of the static response, |g₂| ≤ 1. Exchanging the modes swaps their frequencies and
damping ratios, multiplies the gain by g₂ and replaces g₂ by 1/g₂. (Only the modes of a displacement
pickup can be exchanged: the first mode of a velocity pickup vanishes at low frequency.)
"""

from __future__ import annotations

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
    in_parallel,
)
from vibrident.physics.models.model import Model


def _rational(parameters: Parameters, system: Rational) -> Rational:
    """Return a system with the second mode in parallel."""
    w2 = 2.0 * np.pi * parameters["mode2_frequency"]
    second = (w2 * w2, 2.0 * parameters["mode2_damping"] * w2, 1.0)
    return in_parallel(system, parameters["mode2_gain"] * w2 * w2, second)


_MODE = ("mode2_frequency", "mode2_damping")
_QUESTION = (
    "which mode is the main one; "
    "the shares of the static response are equal within their uncertainty"
)
#: Standard uncertainties by which the shares differ at least where the main mode is decided.
MIN_SHARE_DISTANCE_U = 3.0


def _alternatives(core: Model, values: Values) -> tuple[Relabelling, ...]:
    """Return the exchange of the two modes."""
    if core.output != "displacement" or core.oscillator is None or values["mode2_gain"] == 0.0:
        return ()
    gain = core.parameters[0].name
    frequency, damping = core.oscillator
    frequency_2, damping_2 = _MODE

    def exchange(values: Values) -> dict[str, Any]:
        return dict(values) | {
            gain: values[gain] * values["mode2_gain"],
            frequency: values[frequency_2],
            damping: values[damping_2],
            frequency_2: values[frequency],
            damping_2: values[damping],
            "mode2_gain": 1.0 / values["mode2_gain"],
        }

    return (exchange,)


def _are_in_order(values: Values, exchanged: Values) -> bool:
    """Return whether the first mode has the larger share, or the lower frequency of equal ones."""
    share = abs(values["mode2_gain"])
    return not (
        share > 1.0 or (share == 1.0 and values["mode2_frequency"] < exchanged["mode2_frequency"])
    )


def _are_equal_shares(values: Values, uncertainty: Values) -> bool:
    """Return whether the shares are equal within their uncertainty."""
    return abs(abs(values["mode2_gain"]) - 1.0) <= MIN_SHARE_DISTANCE_U * uncertainty["mode2_gain"]


MODE2 = AddOn(
    name="mode2",
    title="second mode",
    parameters=(
        ParameterSpec(
            "mode2_frequency",
            "Hz",
            "log",
            # In and about the band; the last ones of a sensor of which only the tail is seen.
            guesses=(*np.linspace(-0.1, 1.2, 53).tolist(), 1.3, 1.45, 1.6, 1.8),
            guess_at="band",
            words="second-mode frequency",
            symbol="f2",
            describes="oscillator",
        ),
        ParameterSpec(
            "mode2_damping",
            "1",
            "positive",
            guesses=(0.01, 0.05),
            words="second-mode damping ratio",
            symbol="δ2",
            describes="oscillator",
        ),
        ParameterSpec(
            "mode2_gain",
            "1",
            "ratio",
            guesses=(-0.2, -0.02, 0.02, 0.2),
            words="second-mode gain",
            symbol="g2",
        ),
    ),
    rational=_rational,
    in_series=False,
    oscillator=_MODE,
    share="mode2_gain",
    labels=Labels(_alternatives, _are_in_order, _are_equal_shares, _QUESTION),
)

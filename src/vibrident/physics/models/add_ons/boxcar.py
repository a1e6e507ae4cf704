"""Average over a window of length L, as the digital filter of a MEMS sensor takes it.

Its factor is (1 − e^{−sL})/(sL). Its delay of L/2 is part of it; a ``delay`` add-on comes on top.
It is not a rational function: the network of a model with it runs on the averaged reference.
"""

from __future__ import annotations

from typing import Any

from vibrident.physics.models.base import AddOn, Parameters, ParameterSpec, exponential, sinc


def _factor(parameters: Parameters, s: Any) -> Any:
    """Return F = (1 − e^{−sL})/(sL)."""
    half = 0.5 * s * parameters["boxcar_length"]  # jωL/2
    return exponential(-half) * sinc(half.imag)


def _slopes(parameters: Parameters, s: Any) -> dict[str, Any]:
    """Return ∂F/∂L = (e^{−sL} − F)/L."""
    length = parameters["boxcar_length"]
    return {"boxcar_length": (exponential(-s * length) - _factor(parameters, s)) / length}


BOXCAR = AddOn(
    name="boxcar",
    title="average over a window",
    parameters=(
        ParameterSpec(
            "boxcar_length",
            "s",
            "duration",
            guesses=(0.1, 0.4, 0.8),
            guess_at="period",
            symbol="Tb",
        ),
    ),
    factor=_factor,
    factor_slopes=_slopes,
    window="boxcar_length",
)

"""Cubic stiffness: a spring that hardens (k3 > 0) or softens (k3 < 0) with the displacement.

    V̈ + 2 δ ωn V̇ + ωn² (V + k3 V³) = K a

This is Duffing's oscillator (Kovacic & Brennan 2011). There is no transfer function: a sine comes
out with harmonics, and with a gain that depends on its amplitude (third harmonic k3 A²/4 of the
fundamental A well below resonance, resonance higher by 3/8 k3 A²). The unrolled network runs the
equation from rest: an offset of the reference is no acceleration. What is called frequency response
is that of the linear part, reached for small signals.
"""

from __future__ import annotations

from typing import Any

from vibrident.physics.models.base import AddOn, Parameters, ParameterSpec


def _force(parameters: Parameters, response: Any) -> Any:
    """Return F(V) = −k3 V³."""
    return -parameters["cubic_stiffness"] * response * response * response


CUBIC = AddOn(
    name="cubic",
    title="cubic stiffness",
    parameters=(ParameterSpec("cubic_stiffness", "1/{response}^2", "inverse_square", symbol="k3"),),
    force=_force,
    remark=(
        "The spring is not linear: its force is V + k_3 V³ with the response V and the cubic "
        "stiffness k_3. Sensitivity and curve are those for small signals; with an amplitude V of "
        "the response the stiffness is larger by the part ¾ k_3 V²."
    ),
)

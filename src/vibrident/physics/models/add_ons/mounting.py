"""The sensor on its mounting: surface, coupling, housing and seismic mass as a chain.

The laser sees the surface. A coupling of stiffness k and damping c carries the sensor, whose mass m
is that of the housing and, with a mass ratio μ = seismic mass/housing, of the seismic mass:

    ẍ_h = (1 + μ) (ω_m² (x − x_h) + 2 δ_m ω_m (ẋ − ẋ_h)) − μ (ωn² z + 2 δ ωn ż),
    z̈ + 2 δ ωn ż + ωn² z = ẍ_h,     ω_m² = k/m,  2 δ_m ω_m = c/m,

with x of the surface, x_h of the housing and z of the housing against the seismic mass. With
P = (1 + μ)(2 δ_m ω_m s + ω_m²) and D = s² + 2 δ ωn s + ωn² the housing moves by

    a_h/a = P D / ((s² + P) D + μ s² (2 δ ωn s + ωn²)),

for μ = 0 the series P/(s² + P). Far below both resonances it is 1/(1 − (f/f_m)²) for any μ, as f_m
is of the whole mass. Shimoda, Kokuyama and Nozato (arXiv:2503.17988) fit such a chain of three
bodies to calibrations on adapters of four materials.

``mounting`` alone has μ = 0; ``mounting:0.2`` has μ = 0.2.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.physics.models.base import AddOn, Parameters, ParameterSpec, Rational
from vibrident.physics.models.model import Model
from vibrident.physics.models.ratio import product

_MOUNTING = ("mounting_frequency", "mounting_damping")


def _series(parameters: Parameters, system: Rational) -> Rational:
    """Return a system in series with its coupling, without reaction of the seismic mass."""
    coupling = _coupling(parameters, 1.0)
    return Rational(
        system.gain,
        product(system.numerator, coupling),
        product(system.denominator, (*coupling, 1.0)),
        _scale(system, parameters),
    )


def _coupling(parameters: Parameters, masses: float) -> tuple[Any, Any]:
    """Return P by ascending powers of s; ``masses``: whole mass over that of the housing."""
    frequency, damping = (parameters[name] for name in _MOUNTING)
    w = 2.0 * np.pi * frequency
    return masses * (w * w), masses * (2.0 * damping * w)


def _scale(system: Rational, parameters: Parameters) -> Any:
    """Return the geometric mean of the rates of the system and of its mounting, rad/s."""
    return (system.angular_scale * (2.0 * np.pi * parameters[_MOUNTING[0]])) ** 0.5


@functools.lru_cache(maxsize=64)
def _with_mass_ratio(mass_ratio: float, core: Model) -> AddOn:
    """Return the add-on for a mass ratio above zero.

    Raises:
        ModelError: the ratio is no mass ratio, or the core has no seismic mass.
    """
    if not (math.isfinite(mass_ratio) and mass_ratio > 0.0):
        raise ModelError(
            "This is no ratio of masses.",
            expected="seismic mass over mass of the housing, above 0, such as mounting:0.2",
            found=f"mounting:{mass_ratio:g}",
            where="⟦identify.model⟧",
            remedy="correct it; 'mounting' alone neglects the seismic mass",
        )
    if core.oscillator is None:
        raise ModelError(
            "This model has no seismic mass.",
            expected=f"'{core.name}+mounting', without a mass ratio",
            found=f"'{core.name}+mounting:{mass_ratio:g}'",
            where="⟦identify.model⟧",
            remedy="leave the mass ratio out",
        )
    natural_name, damping_name = core.oscillator

    def chain(parameters: Parameters, system: Rational) -> Rational:
        wn = 2.0 * np.pi * parameters[natural_name]
        spring = (wn * wn, 2.0 * parameters[damping_name] * wn)
        coupling = _coupling(parameters, 1.0 + mass_ratio)
        denominator = list(product((*spring, 1.0), (*coupling, 1.0)))
        for power, coefficient in enumerate(spring, start=2):
            denominator[power] = denominator[power] + mass_ratio * coefficient
        return Rational(
            system.gain,
            product(system.numerator, coupling),
            tuple(denominator),
            _scale(system, parameters),
        )

    return replace(
        MOUNTING,
        name=f"mounting:{mass_ratio!r}",
        title=f"{MOUNTING.title}, seismic mass {mass_ratio:g} of the housing's",
        rational=chain,
        moves_poles=True,
        with_number=None,
    )


MOUNTING = AddOn(
    name="mounting",
    title="coupling between surface and housing",
    parameters=(
        ParameterSpec(
            _MOUNTING[0],
            "Hz",
            "log",
            guesses=tuple(np.linspace(-0.1, 1.3, 29).tolist()),
            guess_at="band",
            symbol="fm",
            describes="channel",
        ),
        ParameterSpec(
            _MOUNTING[1],
            "1",
            "positive",
            guesses=(0.01, 0.1),
            words="mounting damping ratio",
            symbol="δm",
            describes="channel",
        ),
    ),
    rational=_series,
    before_sensor=True,
    oscillator=_MOUNTING,
    with_number=_with_mass_ratio,
)

"""What every sensor model is made of: parameters with units and bounds, a rational transfer function, a delay.

The formulas use only arithmetic operators, so the same lines serve NumPy arrays, JAX arrays and JAX tracers; a
model needs no array library of its own. A sensor is linear and time-invariant here:

    response(s) = gain · N(s)/D(s) · e^{−s τ} · acceleration(s),   D monic.

A reference given as velocity or displacement multiplies N by s or s². An add-on with a ``force`` is the exception: it
acts back on the mass by what the core's response is, in time only, and vanishes faster than the response.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vibrident.records import Quantity

#: Powers of s that turn the reference quantity into acceleration. A drive acts as acceleration up to a constant.
DERIVATIVES: Mapping[str, int] = {"acceleration": 0, "drive": 0, "velocity": 1, "displacement": 2}

Parameters = Mapping[str, Any]  # name → number, array or tracer, SI units except frequencies in Hz


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter of a model.

    Attributes:
        name: contracted name.
        unit: unit; ``{response}`` stands for the response unit, ``{reference}`` for the unit of acceleration or drive.
        kind: how the optimiser sees it. ``gain``: linear, any sign, scaled by its start value; ``log``: positive,
            by its logarithm; ``duration``: positive, by its logarithm, in seconds; ``positive``: linear, reflected at
            zero; ``time``: linear, in units of the shortest time scale of the data; ``ratio``: linear;
            ``inverse``, ``inverse_square``: linear, in units of one over the response's size, or over its square.
        guesses: start values of an add-on's parameter, to be tried in turn, as multiples of what ``guess_at`` says.
        guess_at: ``lowest`` or ``highest`` frequency of the data, ``period`` of the highest, or ``one``; ``band``: the
            guesses are places in the logarithm of frequency, from zero at the lowest to one at the highest.
    """

    name: str
    unit: str
    kind: Literal["gain", "log", "duration", "positive", "time", "ratio", "inverse", "inverse_square"]
    guesses: tuple[float, ...] = ()
    guess_at: Literal["lowest", "highest", "period", "one", "band"] = "one"


@dataclass(frozen=True)
class Rational:
    """gain · N(s)/D(s): coefficients in ascending powers of s, D monic.

    ``angular_scale`` (rad/s) is a typical rate of the system; states are scaled by it to keep numbers near one.
    """

    gain: Any
    numerator: tuple[Any, ...]
    denominator: tuple[Any, ...]
    angular_scale: Any


@dataclass(frozen=True)
class Derived:
    """A function of the estimated parameters that the contract names; it may not exist for all values."""

    name: str
    unit: str
    value: Callable[[Parameters], Any]
    exists: Callable[[Parameters], bool] = lambda parameters: True


@dataclass(frozen=True)
class Core:
    """The sensor proper, without add-ons."""

    name: str
    title: str
    parameters: tuple[ParameterSpec, ...]
    rational: Callable[[Parameters], Rational]
    derived: tuple[Derived, ...]


@dataclass(frozen=True)
class AddOn:
    """What stands in series with, or beside, the core.

    ``rational`` changes the core's transfer function; ``factor`` multiplies its frequency response where that is not
    rational, given s = jω, and ``factor_slopes`` are its derivatives by name. ``force`` makes the sensor nonlinear:
    given the core's response V it is F in V̈ + 2 δ ωn V̇ + ωn² V = K a + ωn² F(V). ``beside`` is what a ``rational``
    adds in parallel to the core, which such a force does not see.
    """

    name: str
    title: str
    parameters: tuple[ParameterSpec, ...]
    rational: Callable[[Parameters, Rational], Rational] | None = None
    delay: Callable[[Parameters], Any] | None = None
    factor: Callable[[Parameters, Any], Any] | None = None
    factor_slopes: Callable[[Parameters, Any], Mapping[str, Any]] | None = None
    force: Callable[[Parameters, Any], Any] | None = None
    beside: Callable[[Parameters, Rational], Rational] | None = None


@dataclass(frozen=True)
class SensorModel:
    """A core with its add-ons; ``name`` is what result.json says."""

    name: str
    core: Core
    add_ons: tuple[AddOn, ...] = ()

    @property
    def parameters(self) -> tuple[ParameterSpec, ...]:
        """All parameters, core first."""
        return self.core.parameters + tuple(spec for addon in self.add_ons for spec in addon.parameters)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters, core first."""
        return tuple(spec.name for spec in self.parameters)

    @property
    def gain_name(self) -> str:
        """Name of the parameter that the response is proportional to."""
        return next(spec.name for spec in self.parameters if spec.kind == "gain")

    def rational(self, parameters: Parameters, quantity: Quantity = "acceleration") -> Rational:
        """Rational part of the transfer function from the reference quantity to the response."""
        system = self.core.rational(parameters)
        for addon in self.add_ons:
            if addon.rational is not None:
                system = addon.rational(parameters, system)
        zeros = (0.0,) * DERIVATIVES[quantity]
        return Rational(system.gain, zeros + system.numerator, system.denominator, system.angular_scale)

    def delay_s(self, parameters: Parameters) -> Any:
        """Delay of the response channel behind the reference channel, s; positive: the response comes later."""
        return sum(addon.delay(parameters) for addon in self.add_ons if addon.delay is not None)

    @property
    def has_delay(self) -> bool:
        """True where the model has a delay parameter."""
        return any(addon.delay is not None for addon in self.add_ons)

    def frequency_response(self, parameters: Parameters, frequency_hz: Any, quantity: Quantity = "acceleration") -> Any:
        """Complex response per unit of the reference quantity, for e^{+jωt}; of a nonlinear model, for small signals.

        Args:
            parameters: name to value.
            frequency_hz: shape (points,).
            quantity: what the reference is.

        Returns:
            Complex array of shape (points,), response unit per SI unit of the quantity; lag has negative phase.
        """
        s = 2j * np.pi * frequency_hz
        system = self.rational(parameters, quantity)
        response = system.gain * polynomial(system.numerator, s) / polynomial(system.denominator, s)
        for addon in self.add_ons:
            if addon.factor is not None:
                response = response * addon.factor(parameters, s)
        if self.has_delay:
            response = response * exponential(-s * self.delay_s(parameters))
        return response

    @property
    def has_network(self) -> bool:
        """True where the model is rational up to a delay, so that it has a state space."""
        return all(addon.factor is None for addon in self.add_ons)

    @property
    def is_linear(self) -> bool:
        """True where no add-on acts back on the mass, so that there is a transfer function."""
        return all(addon.force is None for addon in self.add_ons)

    @property
    def linear(self) -> SensorModel:
        """The model without what makes it nonlinear: what it is for small signals."""
        kept = tuple(addon for addon in self.add_ons if addon.force is None)
        return (
            self
            if self.is_linear
            else SensorModel("+".join([self.core.name, *(a.name for a in kept)]), self.core, kept)
        )

    def blocks(self, parameters: Parameters, quantity: Quantity) -> tuple[Rational, ...]:
        """The core, and what stands beside it, from the reference quantity to their shares of the response."""
        core = self.core.rational(parameters)
        parts = [core, *(addon.beside(parameters, core) for addon in self.add_ons if addon.beside is not None)]
        zeros = (0.0,) * DERIVATIVES[quantity]
        return tuple(Rational(r.gain, zeros + r.numerator, r.denominator, r.angular_scale) for r in parts)

    def force(self, parameters: Parameters, response: Any) -> Any:
        """F(V) of all add-ons, in the shape of ``response``, the core's response V."""
        return sum(addon.force(parameters, response) for addon in self.add_ons if addon.force is not None)

    def derived(self, parameters: Parameters) -> tuple[Derived, ...]:
        """Derived quantities that exist for these parameters."""
        return tuple(quantity for quantity in self.core.derived if quantity.exists(parameters))


def polynomial(coefficients: tuple[Any, ...], s: Any) -> Any:
    """Value of a polynomial with ascending coefficients at ``s``, by Horner's rule."""
    value = coefficients[-1] + 0.0 * s
    for coefficient in reversed(coefficients[:-1]):
        value = value * s + coefficient
    return value


def exponential(z: Any) -> Any:
    """e^z of NumPy or JAX arrays."""
    return array_library(z).exp(z)


def sinc(x: Any) -> Any:
    """sin(x)/x of NumPy or JAX arrays."""
    return array_library(x).sinc(x / np.pi)


def array_library(*values: Any) -> Any:
    """NumPy where every value is a number or a NumPy array, ``jax.numpy`` otherwise."""
    if all(isinstance(value, (np.ndarray, np.generic, complex, float, int)) for value in values):
        return np
    import jax.numpy as jnp  # only tracers and JAX arrays come here, so JAX is loaded already

    return jnp

"""A model with its add-ons: parameters, transfer function, delay, and what is not rational."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.data.records import Quantity, is_motion
from vibrident.physics.models.base import (
    DERIVATIVES,
    AddOn,
    Derived,
    Parameters,
    ParameterSpec,
    Rational,
    exponential,
    polynomial,
)
from vibrident.physics.models.model import Model


@dataclass(frozen=True)
class SensorModel:
    """Core with its add-ons; ``name`` is that of result.json."""

    name: str
    core: Model
    add_ons: tuple[AddOn, ...] = ()

    @property
    def parameters(self) -> tuple[ParameterSpec, ...]:
        """Return all parameters, core first."""
        return (
            *self.core.parameters,
            *(spec for addon in self.add_ons for spec in addon.parameters),
        )

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Return the names of all parameters, core first."""
        return tuple(spec.name for spec in self.parameters)

    @property
    def oscillators(self) -> tuple[tuple[str, str], ...]:
        """Return names of natural frequency and damping ratio of every mode, the core's first."""
        pairs = (self.core.oscillator, *(addon.oscillator for addon in self.add_ons))
        return tuple(pair for pair in pairs if pair is not None)

    @property
    def shares(self) -> tuple[str, ...]:
        """Return the names of the parameters that parallel parts are proportional to."""
        return tuple(addon.share for addon in self.add_ons if addon.share)

    @property
    def factor_names(self) -> tuple[str, ...]:
        """Return the names of the parameters of the factors that are not rational."""
        return tuple(
            spec.name
            for element in self._factored
            for spec in element.parameters
            if spec.kind != "gain"
        )

    @property
    def _factored(self) -> list[Model | AddOn]:
        """Return the parts that are not rational."""
        return [element for element in (self.core, *self.add_ons) if element.factor is not None]

    @property
    def windows(self) -> tuple[str, ...]:
        """Return the names of the lengths of windows over which the sensor averages."""
        return tuple(addon.window for addon in self.add_ons if addon.window)

    def fastest(self, parameters: Parameters) -> float:
        """Return the largest |pole| of the core, rad/s."""
        if self.core.oscillator is None:
            poles = np.roots(
                np.array(self.core.rational(parameters).denominator, dtype=float)[::-1]
            )
            return float(np.max(np.abs(poles))) if poles.size else 0.0
        natural, damping = (parameters[name] for name in self.core.oscillator)
        faster = damping + np.sqrt(damping**2 - 1.0) if damping > 1.0 else 1.0
        return float(2.0 * np.pi * natural * faster)

    def typical_frequency(self, parameters: Parameters) -> float:
        """Return the natural frequency of the core, Hz.

        Where it is no oscillator it is the frequency of its fastest pole.
        """
        if self.core.oscillator is not None:
            return float(parameters[self.core.oscillator[0]])
        return self.fastest(parameters) / (2.0 * np.pi)

    def stated_quantity(self, reference: Quantity) -> Quantity:
        """Return what a sensitivity is stated per: the sensor's own motion, the drive or force.

        A pickup of velocity is stated per m/s, every other sensor per m/s², whatever the
        reference measured.
        """
        if not is_motion(reference):
            return reference
        return "velocity" if self.core.output == "velocity" else "acceleration"

    @property
    def is_gain_alone(self) -> bool:
        """Return whether the core is a gain alone, which one frequency determines."""
        return len(self.core.parameters) == 1

    @property
    def has_gain(self) -> bool:
        """Return whether there is a gain: what free motion alone tells of a model has none."""
        return any(spec.kind == "gain" for spec in self.parameters)

    @property
    def gain_name(self) -> str:
        """Return the name of the parameter that the response is proportional to."""
        return next(spec.name for spec in self.parameters if spec.kind == "gain")

    def rational(self, parameters: Parameters, quantity: Quantity = "acceleration") -> Rational:
        """Return the rational part of the transfer function from reference to response."""
        system = self.core.rational(parameters)
        for addon in self.add_ons:
            if addon.rational is not None:
                system = addon.rational(parameters, system)
        zeros = (0.0,) * (DERIVATIVES[quantity] + self.core.derivative)
        return Rational(
            system.gain, zeros + system.numerator, system.denominator, system.angular_scale
        )

    def poles(self, parameters: Parameters) -> Any:
        """Return the poles of the rational part, rad/s, complex, shape (n,)."""
        return np.roots(np.array(self.rational(parameters).denominator[::-1], dtype=float)).astype(
            complex
        )

    def delay_s(self, parameters: Parameters) -> Any:
        """Return the delay of the response channel behind the reference channel, s.

        It is positive where the response comes later.
        """
        return sum(addon.delay(parameters) for addon in self.add_ons if addon.delay is not None)

    @property
    def has_delay(self) -> bool:
        """Return whether the model has a delay parameter."""
        return any(addon.delay is not None for addon in self.add_ons)

    def frequency_response(
        self, parameters: Parameters, frequency_hz: Any, quantity: Quantity = "acceleration"
    ) -> Any:
        """Return the complex response per unit of the reference quantity, for e^{+jωt}.

        Of a nonlinear model it is that for small signals.

        Args:
            parameters: name to value.
            frequency_hz: shape (points,).
            quantity: what the reference is.

        Returns:
            Complex array of shape (points,), response unit per SI unit of the quantity; lag has
            negative phase.
        """
        s = 2j * np.pi * frequency_hz
        system = self.rational(parameters, quantity)
        response = system.gain * polynomial(system.numerator, s) / polynomial(system.denominator, s)
        if not self.has_network:
            response = response * self.factors(parameters, frequency_hz)
        if self.has_delay:
            response = response * exponential(-s * self.delay_s(parameters))
        return response

    @property
    def has_network(self) -> bool:
        """Return whether the model is rational up to a delay, so that it has a state space."""
        return not self._factored

    @property
    def is_linear(self) -> bool:
        """Return whether no add-on acts back on the mass, so that there is a transfer function."""
        return all(addon.force is None for addon in self.add_ons)

    @property
    def linear(self) -> SensorModel:
        """Return the model without its nonlinear parts: its linearisation for small signals."""
        if self.is_linear:
            return self
        add_ons = tuple(addon for addon in self.add_ons if addon.force is None)
        name = "+".join([self.core.name, *(addon.name for addon in add_ons)])
        return SensorModel(name, self.core, add_ons)

    def factors(self, parameters: Parameters, frequency_hz: Any) -> Any:
        """Return the complex response of the parts that are not rational, shape (points,).

        The delay is left out.
        """
        s = 2j * np.pi * frequency_hz
        return math.prod(
            (element.factor(parameters, s) for element in self._factored if element.factor),
            start=1.0,
        )

    def factor_slopes(self, parameters: Parameters, frequency_hz: Any) -> dict[str, Any]:
        """Return the derivatives of :meth:`factors` with their parameters, by name.

        Each of shape (points,).
        """
        s = 2j * np.pi * frequency_hz
        elements = self._factored
        factors = [
            element.factor(parameters, s) for element in elements if element.factor is not None
        ]
        slopes: dict[str, Any] = {}
        for index, element in enumerate(elements):
            product = math.prod(factors[:index] + factors[index + 1 :], start=1.0)
            element_slopes = element.factor_slopes(parameters, s) if element.factor_slopes else {}
            slopes |= {name: product * slope for name, slope in element_slopes.items()}
        return slopes

    def blocks(self, parameters: Parameters, quantity: Quantity) -> tuple[Rational, ...]:
        """Return the core and the parts parallel to it, whose responses add up to the sensor's."""
        core = self.core.rational(parameters)
        parallel_paths = [
            core,
            *(
                addon.parallel(parameters, core)
                for addon in self.add_ons
                if addon.parallel is not None
            ),
        ]
        zeros = (0.0,) * (DERIVATIVES[quantity] + self.core.derivative)
        return tuple(
            Rational(r.gain, zeros + r.numerator, r.denominator, r.angular_scale)
            for r in parallel_paths
        )

    def force(self, parameters: Parameters, response: Any) -> Any:
        """Return F(V) of all add-ons, in the shape of ``response``, the core's response V."""
        return sum(
            addon.force(parameters, response) for addon in self.add_ons if addon.force is not None
        )

    def derived(self, parameters: Parameters) -> tuple[Derived, ...]:
        """Return the derived quantities that exist for these parameters."""
        return tuple(quantity for quantity in self.core.derived if quantity.exists(parameters))

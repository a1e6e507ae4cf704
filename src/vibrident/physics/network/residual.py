"""The learned residual: a small network beside the physics, fitted to its residual.

Two kinds of hidden neurons, each an add-on to the sensor's model, so that the same recursion, the
same derivative and the same elimination of initial states run physics and network together:

- *memory*: two recurrent neurons, an oscillator driven by the reference. They can learn a resonant
  mount;
- *rational neurons* (Boullé, Nakatsukasa & Townsend 2020), one odd and one even, of the physics'
  response V, with a force on the mass,

      F(V) = −w₃ V³/(1 + s₃² V²) − w₂ V²/(1 + s₂² V²),

  without constant and without slope at V = 0: for small signals they vanish faster than the
  response, and sensitivity, natural frequency and damping keep their meaning. They can learn a
  nonlinear spring.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.physics.models import SensorModel
from vibrident.physics.models.base import (
    AddOn,
    Parameters,
    ParameterSpec,
    Rational,
    in_parallel,
)

#: Start of the neurons' slopes, times the largest response.
INITIAL_SLOPE = 0.5


def _memory(parameters: Parameters, core: Rational) -> Rational:
    """Return the transfer function of the recurrent neurons."""
    w = 2.0 * np.pi * parameters["memory_frequency"]
    damping = parameters["memory_damping"]
    weight = parameters["memory_weight"]
    return Rational(core.gain, (weight * w * w,), (w * w, 2.0 * damping * w, 1.0), w)


def _with_memory(parameters: Parameters, system: Rational) -> Rational:
    """Return a system with the recurrent neurons in parallel."""
    memory = _memory(parameters, system)
    return in_parallel(system, memory.numerator[0], memory.denominator)


def _force(parameters: Parameters, response: Any) -> Any:
    """Return F(V) of the rational neurons, elementwise."""
    square = response * response
    odd = parameters["odd_weight"] * response / (1.0 + parameters["odd_slope"] ** 2 * square)
    even = parameters["even_weight"] / (1.0 + parameters["even_slope"] ** 2 * square)
    return -(odd + even) * square


MEMORY = AddOn(
    name="memory",
    title="two recurrent neurons",
    parameters=(
        ParameterSpec("memory_frequency", "Hz", "log"),
        ParameterSpec("memory_damping", "1", "positive"),
        ParameterSpec("memory_weight", "1", "ratio"),
    ),
    rational=_with_memory,
    parallel=_memory,
)
NEURON_LAYER = AddOn(
    name="neurons",
    title="rational neurons",
    parameters=(
        ParameterSpec("odd_weight", "1/{response}^2", "inverse_square"),
        ParameterSpec("odd_slope", "1/{response}", "inverse"),
        ParameterSpec("even_weight", "1/{response}", "inverse"),
        ParameterSpec("even_slope", "1/{response}", "inverse"),
    ),
    force=_force,
)
#: Parts that may be learned, the simplest first.
ADD_ONS: Mapping[str, AddOn] = {addon.name: addon for addon in (MEMORY, NEURON_LAYER)}
STRUCTURES: tuple[tuple[str, ...], ...] = (("memory",), ("neurons",), ("memory", "neurons"))


def with_residual(model: SensorModel, structure: tuple[str, ...]) -> SensorModel:
    """Return the model with the parts of a residual network behind its own add-ons.

    Raises:
        ModelError: the physics is not an accelerometer's, with or without a delay.
    """
    if model.core.output != "displacement" or not all(addon.is_delay for addon in model.add_ons):
        raise ModelError(
            "The learned residual stands beside an accelerometer's own equation.",
            expected="an accelerometer, with or without a delay",
            found=repr(model.name),
            where="residual network",
            remedy="leave the add-ons to the residual network, or the residual network out",
        )
    return SensorModel(
        "+".join([model.name, *structure]),
        model.core,
        (*model.add_ons, *(ADD_ONS[p] for p in structure)),
    )


def initial_weights(
    structure: tuple[str, ...], response_size: float, memory: Mapping[str, float]
) -> dict[str, float]:
    """Return the parameters of a network whose output is zero, from which it is trained.

    Args:
        structure: its parts.
        response_size: largest response, response unit.
        memory: frequency (Hz) and damping of the recurrent neurons.
    """
    values = {**memory, "memory_weight": 0.0} if "memory" in structure else {}
    if "neurons" in structure:
        slope = INITIAL_SLOPE / response_size
        values |= {"odd_weight": 0.0, "odd_slope": slope, "even_weight": 0.0, "even_slope": slope}
    return values

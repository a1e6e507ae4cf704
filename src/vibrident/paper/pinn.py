"""Physics-informed network of time (Raissi et al. 2019).

The paper's introduction sets its own network against it. One network maps time to the responses of
all training records over a short span; its derivatives in time are exact. The equation of motion,
divided by K, is a second loss, and S0, ωn and δ are trained along:

    V̂_r(t) = network(t)_r          e_r = (V̂̈_r + 2 δ ωn V̂̇_r + ωn² V̂_r)/K − a_r
    loss = mean (V̂_r − V_r)² + mean e_r²        both normalised

Such a network predicts only the records it was trained on; its use is the sensor's parameters.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vibrident.base.backend import jax, jnp
from vibrident.fit.optimise import Progress, silent
from vibrident.paper.dataset import Dataset, reference_signal
from vibrident.paper.training import Schedule, TrainedSensor, train
from vibrident.paper.unrolled import start_of_training
from vibrident.physics.models import SensorModel

#: Steps of a record for training, from the middle: the longest that it learns in a minute or two.
SPAN_STEPS = 1024
#: The network sees sine and cosine of so many multiples of half the span's fundamental.
HARMONICS = 64
#: Neurons of each of the two tanh layers that follow.
HIDDEN_NEURONS = 64
#: Points a batch.
BATCH_POINTS = 128


class CollocationPoints(NamedTuple):
    """Collocation points.

    Attributes:
        time: in units of the span, shape (points,).
        excitation: normalised, shape (points, records).
        response: normalised, shape (points, records).
    """

    time: Any
    excitation: Any
    response: Any


def fit_pinn(
    dataset: Dataset,
    model: SensorModel,
    near: Mapping[str, float],
    schedule: Schedule,
    *,
    seed: int,
    progress: Progress = silent,
) -> TrainedSensor:
    """Train on the middle of the training records, in float64.

    Start values are those of the unrolled network.

    Args:
        dataset: records of one sampling rate, with acceleration or drive as reference.
        model: an accelerometer without add-ons.
        near: first estimate of its parameters, by name.
        schedule: of the training; its batch is ``BATCH_POINTS`` points instead.
        seed: of the random numbers.
        progress: called after each epoch.
    """
    records = [dataset.calibration.records[i] for i in dataset.training]
    span = min(SPAN_STEPS, *(record.samples for record in records))
    first = (records[0].samples - span) // 2
    window = slice(first, first + span)
    excitation = (
        np.stack([reference_signal(r)[window] for r in records], axis=1) / dataset.reference.unit
    )
    response = np.stack([r.response[window] for r in records], axis=1) / dataset.response.unit
    points = CollocationPoints(np.arange(span) / span, excitation, response)
    is_held_back = np.arange(span) % 5 == 4
    duration = span * records[0].sampling_interval_s
    coordinates = start_of_training(model, near)
    gain = dataset.reference.unit / dataset.response.unit

    def loss(variables: dict[str, Any], batch: CollocationPoints) -> Any:
        value, speed, acceleration = _with_derivatives(variables["layers"], batch.time)
        physical = coordinates.physical(variables["sensor"])
        # ωn in units of the span.
        rate = 2.0 * jnp.pi * physical["natural_frequency"] * duration
        motion = acceleration / rate**2 + 2.0 * physical["damping_ratio"] * speed / rate + value
        residual = motion / (physical["sensitivity"] * gain) - batch.excitation
        return jnp.mean(jnp.square(value - batch.response)) + jnp.mean(jnp.square(residual))

    begin = {"layers": _layers(len(records), seed), "sensor": jnp.asarray(coordinates.first)}
    schedule = replace(schedule, batch=BATCH_POINTS)
    training, held_back = (
        CollocationPoints(*(a[selection] for a in points))
        for selection in (~is_held_back, is_held_back)
    )
    rng = np.random.default_rng([seed, 2])
    trained = train(begin, loss, training, held_back, schedule, rng=rng, progress=progress)
    weights = sum(leaf.size for leaf in jax.tree.leaves(begin))
    return TrainedSensor(coordinates.values(np.asarray(trained.model["sensor"])), weights, trained)


def _layers(outputs: int, seed: int) -> list[tuple[Any, Any]]:
    """Return weights and biases (Glorot & Bengio 2010) of two hidden layers and a linear one."""
    rng = np.random.default_rng([seed, 3])
    sizes = (2 * HARMONICS, HIDDEN_NEURONS, HIDDEN_NEURONS, outputs)
    return [
        (jnp.asarray(rng.standard_normal((a, b)) * np.sqrt(2.0 / (a + b))), jnp.zeros(b))
        for a, b in itertools.pairwise(sizes)
    ]


def _network(layers: list[tuple[Any, Any]], time: Any) -> Any:
    angle = jnp.pi * time[:, None] * jnp.arange(1, HARMONICS + 1)
    hidden = jnp.concatenate([jnp.sin(angle), jnp.cos(angle)], axis=1)
    for weight, bias in layers[:-1]:
        hidden = jnp.tanh(hidden @ weight + bias)
    return hidden @ layers[-1][0] + layers[-1][1]


def _with_derivatives(layers: list[tuple[Any, Any]], time: Any) -> tuple[Any, Any, Any]:
    """Return value, first and second derivative in time, shape (points, records) each."""
    unit = jnp.ones_like(time)

    def slope(at: Any) -> Any:
        return jax.jvp(lambda t: _network(layers, t), (at,), (unit,))

    (value, speed), (_, acceleration) = jax.jvp(slope, (time,), (unit,))
    return value, speed, acceleration

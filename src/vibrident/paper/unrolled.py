"""The network as the paper trains it: windows, mean squared error, Adam, weights of the physics.

    hidden   x_{k+1} = φ(W3 x_k + W1 c_k)
    output   y_k     = W2 x_{k+1} + W4 c_k          (eq. 6, Table 1)

φ is the identity, which makes this the sensor's recursion, or tanh as in the paper's Table 3. W1…W4
follow from S0, ωn and δ through a discretisation: Euler's as published, or the exact band-limited
step. The elements are those of ``vibrident.physics.network.cell``; the loop is elementwise over a
batch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from vibrident.base.backend import jax, jnp, lax
from vibrident.data.records import FloatArray
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.problem import Coordinates
from vibrident.paper.dataset import Dataset, NetworkInputs, Windows, cut, scored, whole_records
from vibrident.paper.training import Schedule, TrainedSensor, train
from vibrident.physics.discretisation import method
from vibrident.physics.models import SensorModel, parse
from vibrident.physics.models.state_space import realise

Activation = Literal["linear", "tanh"]
#: Start of training: these multiples of a first estimate from the tones, as a data sheet may
#: deviate.
START = {"sensitivity": 0.9, "natural_frequency": 1.1, "damping_ratio": 1.5}


@dataclass(frozen=True, eq=False)
class TiedNetwork:
    """Network whose weights are tied to the physics, in normalised units.

    Attributes:
        model: the sensor model, without delay.
        dataset: its scales and quantity.
        network_inputs: its inputs.
        activation: of the hidden layer.
    """

    model: SensorModel
    dataset: Dataset
    network_inputs: NetworkInputs
    activation: Activation = "linear"

    def table(self, parameters: Mapping[str, Any], interval_s: float) -> dict[str, Any]:
        """Return W1…W4 for a sampling interval, normalised."""
        quantity = self.dataset.calibration.quantity
        gain = self.dataset.reference.unit / self.dataset.response.unit
        values = {**parameters, self.model.gain_name: parameters[self.model.gain_name] * gain}
        system = realise(self.model.rational(values, quantity))
        return self.network_inputs.method.weights(
            system, interval_s, 0.0, self.network_inputs.terms
        ).table()

    def __call__(self, parameters: Mapping[str, Any], inputs: Any, interval_s: float) -> Any:
        """Return normalised outputs (steps, batch) for inputs (steps, q, batch), from rest."""
        return unrolled(self.table(parameters, interval_s), inputs, self.activation)

    def predict(
        self, parameters: Mapping[str, float], indices: tuple[int, ...]
    ) -> list[FloatArray]:
        """Return the normalised response of each record, at the samples that are scored."""
        inputs = whole_records(self.dataset, indices, self.network_inputs)
        records = [self.dataset.calibration.records[i] for i in indices]
        outputs = []
        for column, record in enumerate(records):
            values = _predicted(
                self,
                dict(parameters),
                inputs[:, :, column : column + 1],
                record.sampling_interval_s,
            )
            outputs.append(np.asarray(values)[scored(record), 0])
        return outputs


def unrolled(table: Mapping[str, Any], inputs: Any, activation: Activation = "linear") -> Any:
    """Return the outputs (steps, batch) of the layers with weights ``table``.

    ``inputs``: shape (steps, q, batch).
    """
    w1, w2, w3, w4 = (table[name] for name in ("W1", "W2", "W3", "W4"))
    order, terms = w1.shape

    def step(state: list[Any], c: Any) -> tuple[list[Any], Any]:
        hidden = [
            sum(w3[i, k] * state[k] for k in range(order))
            + sum(w1[i, j] * c[j] for j in range(terms))
            for i in range(order)
        ]
        if activation == "tanh":
            hidden = [jnp.tanh(value) for value in hidden]
        output = sum(w2[k] * hidden[k] for k in range(order)) + sum(
            w4[j] * c[j] for j in range(terms)
        )
        return hidden, output

    _, outputs = lax.scan(step, [jnp.zeros(inputs.shape[2])] * order, inputs)
    return outputs


_predicted = jax.jit(TiedNetwork.__call__, static_argnums=(0,))


def network_for(
    dataset: Dataset,
    model: SensorModel,
    near: Mapping[str, float],
    discretisation: str = "euler",
    activation: Activation = "linear",
    delay_s: float = 0.0,
) -> TiedNetwork:
    """Return the network of a discretisation.

    ``near``: values near the sensor's, which define its number of inputs.
    """
    step = method(discretisation)
    fastest = 2.0 * np.pi * near["natural_frequency"]
    rate = min(record.sampling_rate_hz for record in dataset.calibration.records)
    direct = len(model.rational(near, dataset.calibration.quantity).numerator) > 2
    return TiedNetwork(
        model, dataset, NetworkInputs(step, step.terms(fastest / rate, direct), delay_s), activation
    )


def fit(
    network: TiedNetwork,
    near: Mapping[str, float],
    schedule: Schedule,
    *,
    seed: int,
    progress: Progress = silent,
) -> TrainedSensor:
    """Train ``network`` by Adam on the training records' windows, all of one sampling rate.

    Training starts at ``START`` times ``near``, the first estimate of the sensor. ``seed``: of the
    shuffling.
    """
    records = network.dataset.calibration.records
    interval = records[network.dataset.training[0]].sampling_interval_s
    coordinates = start_of_training(network.model, near)

    def loss(z: Any, batch: Windows) -> Any:
        outputs = network(coordinates.physical(z), jnp.moveaxis(batch.inputs, 0, -1), interval)
        return weighted_mse(outputs.T, batch)

    windows, held_back = cut(network.dataset, network.network_inputs)
    begin = jnp.asarray(coordinates.first)
    rng = np.random.default_rng([seed, 1])
    trained = train(begin, loss, windows, held_back, schedule, rng=rng, few=True, progress=progress)
    return TrainedSensor(
        coordinates.values(np.asarray(trained.model)), len(coordinates.first), trained
    )


def start_of_training(model: SensorModel, near: Mapping[str, float]) -> Coordinates:
    """Return the coordinates at ``START`` times a first estimate of the sensor."""
    start = {name: near[name] * START[name] for name in model.parameter_names}
    return Coordinates.at(
        model, start, (start["natural_frequency"] / 30.0, start["natural_frequency"] * 30.0)
    )


def weighted_mse(outputs: Any, batch: Windows) -> Any:
    """Return the mean squared error over the scored samples; outputs of shape (windows, steps)."""
    return jnp.sum(batch.score * jnp.square(batch.targets - outputs)) / jnp.sum(batch.score)


def plain_model(name: str) -> SensorModel:
    """Return the paper's model: the core alone, without delay or other add-ons."""
    return parse(name.split("+")[0])

"""GRU and LSTM: networks without physics, on the same windows (the paper's Tables 3 to 5).

    GRU   Cho et al. 2014, doi:10.3115/v1/D14-1179
    LSTM  Hochreiter & Schmidhuber 1997, doi:10.1162/neco.1997.9.8.1735

The cells are equinox's (Table 3: hidden 16, tanh, no bias); a linear layer without bias reads the
output from the hidden state. They compute in float32, as is usual for such networks; their errors
are far larger.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from vibrident.base.backend import equinox as eqx
from vibrident.base.backend import jax, jnp, lax
from vibrident.data.records import FloatArray
from vibrident.paper.dataset import Dataset, Windows, cut, scored, whole_records
from vibrident.paper.training import Schedule, TrainingOutcome, train
from vibrident.paper.unrolled import weighted_mse

Kind = Literal["gru", "lstm"]
#: Unrolled steps in a body of the scan: more takes longer to compile and runs no faster.
_UNROLLED_STEPS = {"gru": 4, "lstm": 1}
#: Neurons of the hidden layer.
HIDDEN_NEURONS = 16


class Recurrent(eqx.Module):
    """Recurrent layer and a linear read-out, neither with a bias.

    Attributes:
        cell: equinox's cell for one step.
        readout: hidden state → output, shape (hidden,).
        kind: ``gru`` or ``lstm``.
    """

    cell: Any
    readout: Any
    kind: Kind = eqx.field(static=True)

    def __init__(self, kind: Kind, *, seed: int) -> None:
        for_cell, for_readout = jax.random.split(jax.random.key(seed))
        make = {"gru": eqx.nn.GRUCell, "lstm": eqx.nn.LSTMCell}[kind]
        self.cell = make(1, HIDDEN_NEURONS, use_bias=False, dtype=jnp.float32, key=for_cell)
        bound = HIDDEN_NEURONS**-0.5
        self.readout = jax.random.uniform(
            for_readout, (HIDDEN_NEURONS,), jnp.float32, -bound, bound
        )
        self.kind = kind

    @property
    def weights(self) -> int:
        """Return the number of weights that training moves."""
        return sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(self, eqx.is_inexact_array)))

    def __call__(self, inputs: Any) -> Any:
        """Return the outputs, shape (steps, batch), for inputs of the same shape.

        The hidden state is zero at the first step.
        """
        zero = jnp.zeros((inputs.shape[1], self.readout.shape[0]), jnp.float32)
        start = (zero, zero) if self.kind == "lstm" else zero

        def step(state: Any, value: Any) -> tuple[Any, Any]:
            state = jax.vmap(self.cell)(value[:, None], state)
            return state, (state[0] if self.kind == "lstm" else state) @ self.readout

        _, outputs = lax.scan(
            step, start, inputs.astype(jnp.float32), unroll=_UNROLLED_STEPS[self.kind]
        )
        return outputs


def fit_recurrent(
    dataset: Dataset, kind: Kind, schedule: Schedule, *, seed: int
) -> TrainingOutcome:
    """Train a recurrent network in float32 on the training records' windows."""
    windows, held_back = (
        Windows(*(a.astype(np.float32) for a in data_windows)) for data_windows in cut(dataset)
    )

    def loss(network: Any, batch: Windows) -> Any:
        return weighted_mse(network(batch.inputs[:, :, 0].T).T, batch)

    network = Recurrent(kind, seed=seed)
    rng = np.random.default_rng([seed, 1])
    return train(network, loss, windows, held_back, schedule, rng=rng)


def predict_recurrent(
    network: Recurrent, dataset: Dataset, indices: tuple[int, ...]
) -> list[FloatArray]:
    """Return the normalised response of records from a zero state, at the scored samples."""
    inputs = whole_records(dataset, indices)
    outputs = np.asarray(_outputs(network, jnp.asarray(inputs[:, 0, :])), dtype=float)
    records = [dataset.calibration.records[i] for i in indices]
    return [outputs[scored(record), column] for column, record in enumerate(records)]


@jax.jit
def _outputs(network: Recurrent, inputs: Any) -> Any:
    return network(inputs)

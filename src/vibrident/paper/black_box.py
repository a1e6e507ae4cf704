"""GRU and LSTM on the same windows as the network with physics (the paper's Tables 3 to 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.backend import jax, jnp
from vibrident.network.recurrent import Kind, Recurrent
from vibrident.network.training import Progress, Schedule, Trained, train
from vibrident.paper.dataset import Dataset
from vibrident.paper.unrolled import weighted_mse
from vibrident.paper.windows import Windows, cut, scored, whole_records
from vibrident.records import FloatArray

HIDDEN = 16


@dataclass(frozen=True, eq=False)
class FittedRecurrent:
    """A trained recurrent network and its training."""

    network: Recurrent
    trained: Trained


def fit_recurrent(
    dataset: Dataset, kind: Kind, schedule: Schedule, *, seed: int, progress: Progress | None = None
) -> FittedRecurrent:
    """Train a recurrent network in float32 on the training records' windows."""
    windows, held_back = (Windows(*(a.astype(np.float32) for a in part)) for part in cut(dataset))

    def loss(network: Any, batch: Windows) -> Any:
        return weighted_mse(network(batch.inputs[:, :, 0].T).T, batch)

    network = Recurrent(kind, hidden=HIDDEN, seed=seed)
    rng = np.random.default_rng([seed, 1])
    trained = train(network, loss, windows, held_back, schedule, rng=rng, progress=progress)
    return FittedRecurrent(trained.model, trained)


def predict_recurrent(network: Recurrent, dataset: Dataset, indices: tuple[int, ...]) -> list[FloatArray]:
    """Normalised response of whole records from a zero state, the samples that are scored."""
    inputs = whole_records(dataset, indices)
    outputs = np.asarray(_outputs(network, jnp.asarray(inputs[:, 0, :])), dtype=float)
    records = [dataset.calibration.records[i] for i in indices]
    return [outputs[scored(record), column] for column, record in enumerate(records)]


@jax.jit
def _outputs(network: Recurrent, inputs: Any) -> Any:
    return network(inputs)

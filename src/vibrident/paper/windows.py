"""Records cut into windows for training in batches, the same windows for every network.

A window begins with steps that are run but not scored, in which a network that starts from zero settles (its state
decays as e^{−δ ωn t}). Windows overlap so that every later sample is scored once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vibrident.discretize import Method, method
from vibrident.paper.dataset import Dataset
from vibrident.records import FloatArray, Record

#: Steps of a window that are run and not scored, also at the beginning of a record.
RUN_IN = 512
#: Steps of a window that are scored.
SCORED = 512
#: Steps at the end of a record that are not scored.
RUN_OUT = 40
#: One of so many windows of the training records is held back for early stopping: 8:2 again.
HOLD_BACK = 5


class Windows(NamedTuple):
    """Normalised windows: inputs (W, L, q), targets (W, L), score (W, L), one where a sample counts."""

    inputs: Any
    targets: Any
    score: Any


@dataclass(frozen=True)
class Seen:
    """Inputs of a network: the samples, or the coefficients of the band-limited signal.

    Attributes:
        method: the discretisation.
        terms: inputs a step.
        delay_s: delay at which the inputs are taken.
    """

    method: Method
    terms: int = 1
    delay_s: float = 0.0

    def of(self, record: Record, unit: float) -> FloatArray:
        """Normalised inputs of a record, shape (samples, terms)."""
        assert record.reference is not None
        late = self.delay_s * record.sampling_rate_hz
        return (
            self.method.inputs(record.reference, np.ones(record.samples, dtype=bool), self.terms, late).coefficients
            / unit
        )


SAMPLES = Seen(method("euler"))


def cut(dataset: Dataset, seen: Seen = SAMPLES) -> tuple[Windows, Windows]:
    """Windows of the training records to train on, and those held back."""
    parts = [_of_record(dataset, dataset.calibration.records[i], seen) for i in dataset.training]
    whole = Windows(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    held = np.arange(len(whole.targets)) % HOLD_BACK == HOLD_BACK - 1
    return Windows(*(a[~held] for a in whole)), Windows(*(a[held] for a in whole))


def _of_record(dataset: Dataset, record: Record, seen: Seen) -> Windows:
    starts = np.arange(0, record.samples - RUN_OUT - RUN_IN - SCORED + 1, SCORED)
    take = starts[:, None] + np.arange(RUN_IN + SCORED)
    score = record.mask.astype(float)[take]
    score[:, :RUN_IN] = 0.0
    return Windows(
        seen.of(record, dataset.reference.unit)[take], (record.response / dataset.response.unit)[take], score
    )


def scored(record: Record) -> slice:
    """The samples of a whole record on which predictions are compared."""
    return slice(RUN_IN, record.samples - RUN_OUT)


def whole_records(dataset: Dataset, indices: Sequence[int], seen: Seen = SAMPLES) -> FloatArray:
    """Normalised inputs, shape (longest, q, records), padded with zeros."""
    records = [dataset.calibration.records[i] for i in indices]
    inputs = np.zeros((max(r.samples for r in records), seen.terms, len(records)))
    for column, record in enumerate(records):
        inputs[: record.samples, :, column] = seen.of(record, dataset.reference.unit)
    return inputs

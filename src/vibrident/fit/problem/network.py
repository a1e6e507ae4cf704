"""Which network a model has over its records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vibrident.data.records import Quantity, Record
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.problem.network_problem import NetworkProblem
from vibrident.physics.discretisation import Method
from vibrident.physics.discretisation.inputs import filtered
from vibrident.physics.models import SensorModel


def network_of(
    records: Sequence[Record],
    model: SensorModel,
    method: Method,
    quantity: Quantity,
    start: Mapping[str, float],
) -> NetworkProblem:
    """The network over records: at the bins of its transform where the model is linear, in time where not.

    Factors that are not rational, as of a digital average, act on the reference before it, with the start values.

    Raises:
        InputError: no record is long enough.
    """
    if not model.has_network:
        records, model = [_behind_factors(record, model, start) for record in records], model.rational_part
    if model.is_linear:
        return BinProblem.build(records, model, method, quantity, start)
    from vibrident.fit.problem.time_domain import TimeProblem

    return TimeProblem.build(records, model, method, quantity, start)


def _behind_factors(record: Record, model: SensorModel, values: Mapping[str, float]) -> Record:
    """The record with its reference behind the parts of a model that are not rational."""
    if record.reference is None:
        return record
    rate, used = record.sampling_rate_hz, record.reference_mask
    rest = float(np.mean(record.reference[used])) if used.any() else 0.0
    moved, valid = filtered(record.reference - rest, used, lambda turns: model.factors(values, turns * rate))
    return replace(record, reference=moved + rest * float(np.real(model.factors(values, 0.0))), reference_valid=valid)

"""The network of a sensor over its records, by whichever way it is run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.fit.bins import RecordBins
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.framing import Frame
from vibrident.physics.discretisation import Method, Weights
from vibrident.physics.discretisation.inputs import filtered
from vibrident.physics.models import SensorModel


class NetworkProblem(Protocol):
    """Measured response minus the network's, weighted by each record's noise; initial states and offsets eliminated."""

    @property
    def records(self) -> tuple[Record, ...]:
        """In order."""
        ...

    @property
    def frame(self) -> Frame:
        """Shape of the network, and the delay at which its inputs were interpolated."""
        ...

    @property
    def degrees_of_freedom(self) -> FloatArray:
        """Numbers that count less initial states and offset, for every record, shape (records,)."""
        ...

    @property
    def noise_floor(self) -> FloatArray:
        """Lower limit of the standard deviation of each record's residual, response unit, shape (records,)."""
        ...

    def normal(self, z: FloatArray, coordinates: Coordinates, noise: FloatArray) -> Any:
        """Cost, gradient and normal matrix at ``z``; ``noise``: standard deviation of each record, shape (records,)."""
        ...

    def record_noise(self, normal: Any, noise: FloatArray) -> FloatArray:
        """Standard deviation of each record's residual, shape (records,), of normal equations weighted by ``noise``."""
        ...

    def lines(self, z: FloatArray, coordinates: Coordinates, noise: FloatArray) -> list[RecordBins]:
        """Every record at the bins of its transform, in order."""
        ...

    def predict(self, coordinates: Coordinates, z: FloatArray) -> list[FloatArray]:
        """Response of every record with the best initial states and offsets, NaN where the network gives no value."""
        ...

    def at_delay_of(self, values: Mapping[str, float]) -> NetworkProblem:
        """The same with inputs interpolated at the delay of ``values``; itself where they nearly are."""
        ...

    def idle(self) -> NetworkProblem:
        """The same with less memory, for rare use."""
        ...

    def weights(self, values: Mapping[str, float]) -> Weights:
        """Network weights of the linear part, one set a sampling interval in order (leading axis)."""
        ...


def network_objective(z: FloatArray, args: tuple[Coordinates, NetworkProblem, FloatArray]) -> Any:
    """The residual in the form of the optimisers; args: coordinates, problem, noise of each record."""
    coordinates, problem, noise = args
    return problem.normal(np.asarray(z, dtype=float), coordinates, noise)


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

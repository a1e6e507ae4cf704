"""The network of a sensor over its records, by whichever way it is run."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from vibrident.base.errors import InputError, ModelError
from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.response.response import MIN_RELATIVE_DEVIATION
from vibrident.fit.response.rounding import converter_step
from vibrident.physics.discretisation import Method, Weights
from vibrident.physics.models import SensorModel

#: Part of a sample by which a delay may leave that of the interpolated inputs.
DELAY_SETTLED = 1e-5
#: Part by which a factor's parameter may leave that of the inputs: they are exact to its square.
FACTOR_SETTLED = 1e-5


@dataclass(frozen=True)
class Frame:
    """What network it is, and its shape.

    Attributes:
        model: the sensor model.
        method: the discretisation.
        quantity: what the reference is.
        delay_s: at which the inputs are taken, s.
        order: number of states n.
        terms: inputs a step q.
        fastest: largest |pole| at the start values, rad/s.
        factor_values: parameters of the factors that are not rational, by name, at which the
            reference is taken.
    """

    model: SensorModel
    method: Method
    quantity: Quantity
    delay_s: float
    order: int
    terms: int
    fastest: float
    factor_values: Mapping[str, float]

    @classmethod
    def of(
        cls,
        records: Sequence[Record],
        model: SensorModel,
        method: Method,
        quantity: Quantity,
        start: Mapping[str, float],
    ) -> Frame:
        """The shape that these records need.

        Args:
            records: at least one; a record without reference is a free decay, its input is zero.
            model: the sensor model.
            method: the discretisation.
            quantity: what the reference is.
            start: start values of the parameters; the natural frequency and damping set how many inputs a step
                are needed, the delay where they are interpolated.
        """
        delay = float(np.asarray(model.delay_s(start))) if model.has_delay else 0.0
        system = model.rational(start, quantity)
        order = len(system.denominator) - 1
        direct = len(system.numerator) > order  # the response then contains the reference itself
        fastest = model.fastest(start)
        intervals = {record.sampling_interval_s for record in records}
        terms = max(method.terms(fastest * interval, direct=direct) for interval in intervals)
        factor_values = {name: float(start[name]) for name in model.factor_names}
        return cls(model, method, quantity, delay, order, terms, fastest, factor_values)

    @property
    def fewest(self) -> int:
        """A run is used that has more samples than this."""
        return 2 * (self.order + 1)

    def too_short(self, records: Sequence[Record]) -> InputError:
        """The error that no record is long enough."""
        return InputError(
            "No record is long enough for the network.",
            expected=f"more than {self.fewest} samples that can be used after interpolation",
            found=f"{max(r.samples for r in records)} samples in the longest record",
            where="records",
            remedy="use longer records, or the estimator 'auto' with sine records",
        )


@dataclass(frozen=True, eq=False)
class NetworkProblem(ABC):
    """The network over records; initial states and offsets are eliminated.

    Attributes:
        records: the records, in order.
        frame: shape of the network, and the delay at which its inputs were interpolated.
    """

    records: tuple[Record, ...]
    frame: Frame

    @classmethod
    def build(
        cls,
        records: Sequence[Record],
        model: SensorModel,
        method: Method,
        quantity: Quantity,
        start: Mapping[str, float],
    ) -> Self:
        """Prepare the records, with inputs interpolated at the expected delay; args: as of :meth:`Frame.of`.

        Raises:
            InputError: no record is long enough.
        """
        return cls.of_frame(tuple(records), Frame.of(records, model, method, quantity, start))

    @classmethod
    @abstractmethod
    def of_frame(cls, records: tuple[Record, ...], frame: Frame) -> Self:
        """The records as such a network sees them.

        Raises:
            InputError: no record is long enough.
        """

    @abstractmethod
    def predict(self, coordinates: Coordinates, z: FloatArray) -> list[FloatArray]:
        """Response of every record with the best initial states and offsets, NaN where the network gives no value."""

    @abstractmethod
    def weights(self, values: Mapping[str, float]) -> Weights:
        """Network weights of the linear part, one set a sampling interval in order (leading axis)."""

    @functools.cached_property
    def noise_floor(self) -> FloatArray:
        """Lower limit of the standard deviation of each record's residual, response unit, shape (records,)."""
        return np.array([noise_floor_of(record) for record in self.records])

    def at_delay_of(self, values: Mapping[str, float]) -> Self:
        """Return the same with inputs at the delay and factors of ``values``.

        Itself where they nearly are.
        """
        frame, shortest = self.frame, min(record.sampling_interval_s for record in self.records)
        late = abs(float(frame.model.delay_s(values)) - frame.delay_s) > DELAY_SETTLED * shortest
        factors = frame.factor_values.items()
        moved = any(abs(values[name] - at) > FACTOR_SETTLED * abs(at) for name, at in factors)
        if not late and not moved:
            return self
        return self.build(self.records, frame.model, frame.method, frame.quantity, values)

    def idle(self) -> Self:
        """The same with less memory, for rare use."""
        return self


def noise_floor_of(record: Record) -> float:
    """Return the lower limit of the standard deviation of a record's residual, response unit."""
    least = (
        MIN_RELATIVE_DEVIATION * float(np.std(record.response[record.mask]))
        if record.mask.any()
        else 0.0
    )
    step = converter_step(record.response, record.mask) / np.sqrt(12.0)
    return max(least, step, float(np.finfo(float).tiny))


def require_rational(model: SensorModel) -> None:
    """Refuse a model whose network in time cannot be trained.

    Raises:
        ModelError: the model is not rational.
    """
    if model.has_network:
        return
    parts = (model.core, *model.add_ons)
    factors = " or ".join(repr(part.name) for part in parts if part.factor is not None)
    raise ModelError(
        "The network cannot be trained in time: the model is not a rational function.",
        expected=f"a model without {factors}",
        found=repr(model.name),
        where="estimator",
        remedy="use the estimator 'auto' with a linear model",
    )


def network_objective(z: FloatArray, args: tuple[Coordinates, Any, FloatArray]) -> Any:
    """Return the residual in the form of the optimisers; args: coordinates, network in time, noise of each record."""
    coordinates, problem, noise = args
    return problem.normal(np.asarray(z, dtype=float), coordinates, noise)

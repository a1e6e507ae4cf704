"""The network of a sensor over its records, in time or at the bins of their transforms."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from vibrident.base.errors import InputError, ModelError
from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.response.response import MIN_RELATIVE_DEVIATION
from vibrident.fit.response.rounding import converter_step
from vibrident.physics.discretisation import Method, Weights
from vibrident.physics.discretisation.inputs import USABLE_BAND
from vibrident.physics.models import SensorModel

#: Fraction of a sample by which a delay may differ from that of the interpolated inputs.
MAX_DELAY_CHANGE_SAMPLES = 1e-5
#: Bins up to this many times the highest frequency of the motion count: beyond, only a misfit
#: caused by motion and the level of the noise are visible.
BAND_MARGIN = 1.5
#: Fewest bins, where there are so many: fewer do not determine the noise.
MIN_BINS = 256
#: Fraction by which a factor's parameter may differ from that of the inputs, which are exact to its
#: square.
MAX_FACTOR_CHANGE = 1e-5


@dataclass(frozen=True)
class Frame:
    """Shape of a network, and the values at which its inputs are taken.

    Attributes:
        model: the sensor model.
        method: the discretisation.
        quantity: of the reference.
        delay_s: at which the inputs are taken, s.
        order: number of states n.
        terms: inputs a step q.
        fastest: largest |pole| at the start values, rad/s.
        factor_values: parameters of the factors that are not rational, by name, at which the
            reference is taken.
        top_hz: highest frequency of the motion, for which inputs are accurate; infinite where it
            is not known, tones may have harmonics above it, or no accuracy depends on it; zero of
            a look at what moves.
        reference_offsets: of the records, in the reference's unit, which a nonlinear spring feels;
            None: those of :func:`vibrident.fit.response.rest.offset_of_reference`.
        zeros: of the response over the reference, at frequency zero.
    """

    model: SensorModel
    method: Method
    quantity: Quantity
    delay_s: float
    order: int
    terms: int
    fastest: float
    factor_values: Mapping[str, float]
    top_hz: float = np.inf
    reference_offsets: tuple[float, ...] | None = None
    zeros: int = 0

    @classmethod
    def of(
        cls,
        records: Sequence[Record],
        model: SensorModel,
        method: Method,
        quantity: Quantity,
        start: Mapping[str, float],
        top_hz: float = np.inf,
    ) -> Frame:
        """Return the frame that these records need.

        Args:
            records: at least one; a record without reference is a free decay, its input is zero.
            model: the sensor model.
            method: the discretisation.
            quantity: of the reference.
            start: start values of the parameters; the natural frequency and damping set how many
                inputs a step are needed, the delay where they are interpolated.
            top_hz: highest frequency of the motion.
        """
        delay = float(np.asarray(model.delay_s(start))) if model.has_delay else 0.0
        system = model.rational(start, quantity)
        order = len(system.denominator) - 1
        direct = len(system.numerator) > order  # the response then contains the reference itself
        fastest = model.fastest(start)
        if not method.is_band_limited or any(record.excitation == "sine" for record in records):
            top_hz = np.inf
        steps = {(r.sampling_interval_s, counted_band(r, top_hz)) for r in records}
        terms = max(method.terms(fastest * interval, direct, band) for interval, band in steps)
        terms = terms if top_hz > 0.0 else 1  # a look needs the first input alone
        factor_values = {name: float(start[name]) for name in model.factor_names}
        zeros = next((power for power, factor in enumerate(system.numerator) if factor != 0.0), 0)
        return cls(
            model,
            method,
            quantity,
            delay,
            order,
            terms,
            fastest,
            factor_values,
            top_hz,
            zeros=zeros,
        )

    @property
    def fewest(self) -> int:
        """Return the number of samples that a run must exceed to be used."""
        return 2 * (self.order + 1)

    def too_short(self, records: Sequence[Record]) -> InputError:
        """Return the error that no record is long enough."""
        return InputError(
            "No record is long enough for the network.",
            expected=f"more than {self.fewest} samples that can be used after interpolation",
            found=f"{max(r.samples for r in records)} samples in the longest record",
            where="records",
            remedy="use longer records, or the estimator 'auto' with sine records",
        )


@dataclass(frozen=True, eq=False)
class NetworkProblem(ABC):
    """Network over records, whose initial states and offsets are eliminated.

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
        top_hz: float = np.inf,
    ) -> Self:
        """Return the problem with inputs interpolated at the expected delay.

        The arguments are those of :meth:`Frame.of`.

        Raises:
            InputError: no record is long enough.
        """
        return cls.of_frame(
            tuple(records), Frame.of(records, model, method, quantity, start, top_hz)
        )

    @classmethod
    @abstractmethod
    def of_frame(cls, records: tuple[Record, ...], frame: Frame) -> Self:
        """Return the problem of records for a network of this frame.

        Raises:
            InputError: no record is long enough.
        """

    @abstractmethod
    def predict(self, coordinates: Coordinates, z: FloatArray) -> list[FloatArray]:
        """Return the response of every record, with the best initial states and offsets.

        NaN where the network gives no value.
        """

    @abstractmethod
    def weights(self, values: Mapping[str, float]) -> Weights:
        """Return the network weights of the linear part, by sampling interval (leading axis)."""

    @functools.cached_property
    def noise_floor(self) -> FloatArray:
        """Return the lower limit of each residual's deviation, response unit, shape (records,)."""
        return np.array([noise_floor_of(record) for record in self.records])

    def at_delay_of(self, values: Mapping[str, float]) -> Self:
        """Return the problem with inputs at the delay and factors of ``values``.

        Itself where they differ by next to nothing.
        """
        if not self.is_far(values, MAX_DELAY_CHANGE_SAMPLES):
            return self
        frame = self.frame
        moved = Frame.of(
            self.records, frame.model, frame.method, frame.quantity, values, frame.top_hz
        )
        moved = replace(moved, reference_offsets=frame.reference_offsets)
        return self.of_frame(self.records, moved)

    def is_far(self, values: Mapping[str, float], samples: float) -> bool:
        """Return whether the inputs are at another delay by so many samples, or other factors."""
        frame = self.frame
        shortest = min(record.sampling_interval_s for record in self.records)
        delay_change = abs(float(frame.model.delay_s(values)) - frame.delay_s)
        return delay_change > samples * shortest or any(
            abs(values[name] - value) > MAX_FACTOR_CHANGE * abs(value)
            for name, value in frame.factor_values.items()
        )

    def idle(self) -> Self:
        """Return the problem with less memory, for rare use."""
        return self


def counted_band(record: Record, top_hz: float) -> float:
    """Return the highest frequency that counts in a record, over its sampling rate.

    ``top_hz``: highest frequency of the motion.
    """
    highest = max(BAND_MARGIN * top_hz / record.sampling_rate_hz, MIN_BINS / record.samples)
    return float(min(highest, USABLE_BAND))


def noise_floor_of(record: Record) -> float:
    """Return the lower limit of the standard deviation of a record's residual, response unit."""
    rounding_floor = (
        MIN_RELATIVE_DEVIATION * float(np.std(record.response[record.mask]))
        if record.mask.any()
        else 0.0
    )
    step = converter_step(record.response, record.mask) / np.sqrt(12.0)
    return max(rounding_floor, step, float(np.finfo(float).tiny))


def require_rational(model: SensorModel) -> None:
    """Refuse a model whose network in time cannot be trained.

    Raises:
        ModelError: the model is not rational.
    """
    if model.has_network:
        return
    components = (model.core, *model.add_ons)
    factors = " or ".join(
        repr(component.name) for component in components if component.factor is not None
    )
    raise ModelError(
        "The network cannot be trained in time: the model is not a rational function.",
        expected=f"a model without {factors}",
        found=repr(model.name),
        where="⟦identify.estimator⟧",
        remedy="use the estimator 'auto' with a linear model",
    )


def network_objective(z: FloatArray, args: tuple[Coordinates, Any, FloatArray]) -> Any:
    """Return the normal equations in the form of the optimisers.

    Args:
        z: coordinates, shape (parameters,).
        args: coordinates, network in time, noise of each record.
    """
    coordinates, problem, noise = args
    return problem.normal(np.asarray(z, dtype=float), coordinates, noise)

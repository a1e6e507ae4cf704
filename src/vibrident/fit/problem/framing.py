"""The frame of a network before it processes samples: number of states and inputs, and delay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError, ModelError
from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.fit.response.response import LEAST_DEVIATION
from vibrident.fit.response.rounding import converter_step
from vibrident.physics.discretisation import Method
from vibrident.physics.models import SensorModel

#: Part of a sample by which a delay may leave that of the interpolated inputs.
DELAY_SETTLED = 1e-5


@dataclass(frozen=True)
class Frame:
    """The shape of a network.

    Attributes:
        delay_s: at which the inputs are taken, s.
        order: number of states n.
        terms: inputs a step q.
        fastest: largest |pole| at the start values, rad/s.
    """

    delay_s: float
    order: int
    terms: int
    fastest: float

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

        Raises:
            ModelError: the model is not rational.
        """
        if not model.has_network:
            raise ModelError(
                "The network cannot be trained: the model is not a rational function.",
                expected="a model without "
                + " or ".join(repr(addon.name) for addon in model.add_ons if addon.factor is not None),
                found=repr(model.name),
                where="estimator",
                remedy="use the estimator 'auto', with sine records or a table",
            )
        delay = float(np.asarray(model.delay_s(start))) if model.has_delay else 0.0
        system = model.rational(start, quantity)
        order = len(system.denominator) - 1
        direct = len(system.numerator) > order  # the response then contains the reference itself
        fastest = model.fastest(start)
        intervals = {record.sampling_interval_s for record in records}
        terms = max(method.terms(fastest * interval, direct=direct) for interval in intervals)
        return cls(delay, order, terms, fastest)

    def settled(self, delay_s: float, records: Sequence[Record]) -> bool:
        """Whether a delay is nearly that of the inputs."""
        shortest = min(record.sampling_interval_s for record in records)
        return abs(delay_s - self.delay_s) <= DELAY_SETTLED * shortest

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


def noise_floor(records: Sequence[Record]) -> FloatArray:
    """Lower limit of the standard deviation of each record's residual, response unit, shape (records,)."""
    floor = [LEAST_DEVIATION * float(np.std(record.response[record.mask])) for record in records]
    steps = [converter_step(record.response, record.mask) / np.sqrt(12.0) for record in records]
    return np.maximum(np.maximum(floor, steps), np.finfo(float).tiny)


def response_size(records: Sequence[Record]) -> float:
    """Largest distance of a valid response sample from its record's mean, response unit; one without any."""
    valid = [record.response[record.mask] for record in records]
    return max((float(np.max(np.abs(y - y.mean()))) for y in valid if y.size), default=0.0) or 1.0

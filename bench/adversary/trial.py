"""A trial: the calibration that the package is given, and what is true of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.adversary.defects import Raw
from bench.adversary.physics import TAU, Sensor
from vibrident import Calibration, Record

Maker = Callable[[np.random.Generator], "Trial"]
Cases = Iterator[tuple[str, Maker]]


@dataclass(frozen=True)
class Trial:
    """Trial that is put to the package.

    Attributes:
        calibration: made when called; it may refuse.
        model: asked for.
        truth: name of a parameter to its value; only these are judged.
        cause: what is wrong, for the summary; "" where nothing is.
        allowed: warnings that are true of these data though nothing is wrong with them.
        strange: not a defect, but what a refusal is a right answer to.
        sound: the same recordings, noise and all, without what is wrong.
        drawn: what chance has set, for who reads a failure.
        expected: warnings that name what is wrong.
        compared: whether u is held against that of the same recordings without what is wrong.
    """

    calibration: Callable[[], Calibration]
    model: str
    truth: Mapping[str, float]
    cause: str = ""
    allowed: frozenset[str] = frozenset()
    strange: bool = False
    sound: Callable[[], Calibration] | None = None
    drawn: str = ""
    expected: frozenset[str] = frozenset()
    compared: bool = False

    @classmethod
    def from_recordings(
        cls, recordings: Sequence[Raw], sensor: Sensor, quantity: str, **more: Any
    ) -> Trial:
        """Return the trial of recordings by the sensor's own model; ``more``: its other fields."""
        make = calibration(recordings, sensor.model, quantity)
        return cls(make, sensor.model, truth(sensor), **more)


def calibration(
    records: Sequence[Raw], model: str, quantity: str, **more: object
) -> Callable[[], Calibration]:
    """Return recordings as the package takes them."""

    def make() -> Calibration:
        converted = tuple(
            Record(
                name=r.name,
                reference=None if r.excitation == "decay" else r.reference,
                response=r.response,
                sampling_rate_hz=r.rate,
                excitation=r.excitation,  # type: ignore[arg-type]
                frequency_hz=r.frequency_hz,
            )
            for r in records
        )
        return Calibration(
            records=converted,
            model=model,
            quantity=quantity,  # type: ignore[arg-type]
            **more,
        )

    return make


def truth(sensor: Sensor) -> dict[str, float]:
    """Return the parameters of the sensor, and what follows from them."""
    values = dict(sensor.parameters)
    angular = TAU * values["natural_frequency"]
    values["natural_angular_frequency"] = angular
    damping_term = 1.0 - 2.0 * values["damping_ratio"] ** 2
    if sensor.parts[0] == "accelerometer":
        values["conversion_coefficient"] = values["sensitivity"] * angular**2
        if damping_term > 0.0:
            values["resonance_frequency"] = values["natural_frequency"] * np.sqrt(damping_term)
    elif damping_term > 0.0:
        values["resonance_frequency"] = values["natural_frequency"] / np.sqrt(damping_term)
    return values

"""Dry friction in the sensor: −H{sgn ẋ}, with ẋ the velocity of its mass in the case."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Scale, Shape, Size
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray


class Friction(Shape):
    """Coulomb's force against the velocity of the mass, which acts as an acceleration."""

    name: ClassVar[str] = "friction"
    code: ClassVar[WarningCode] = "nonlinear"

    def shapes(self, signal: FloatArray, size: Size) -> Iterable[tuple[str, FloatArray]]:
        """Yield the sign of the velocity, per m/s² of deceleration."""
        if size.scale.mass is not None:
            yield "", -size.sign(signal)

    def signal(self, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return the velocity of the mass, shape (R, L)."""
        return group.series(group.likely * self.gain(group, scale))

    def answer(self, group: WhitenedGroup, scale: Scale) -> ComplexArray | float:
        """Return the sensor's response to an acceleration, shape (K,)."""
        return 0.0 if scale.mass is None else scale.mass(group.hz)[1]

    def gain(self, group: WhitenedGroup, scale: Scale) -> ComplexArray | float:
        """Return the velocity of the mass for a response of one, shape (K,)."""
        if scale.mass is None:
            return 0.0
        velocity, response = scale.mass(group.hz)
        return np.divide(velocity, response, out=np.zeros_like(velocity), where=response != 0.0)

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return how large the friction is."""
        size = float(score.amounts[0])
        if size < 0.0:
            return (
                "the response departs by the sign of the velocity of the sensor's mass, "
                "against what friction does"
            )
        return (
            f"the mass of the sensor is held by dry friction, {amount(size, 'm/s²', 2)}; "
            "a linear sensor has none"
        )


FRICTION = Friction()

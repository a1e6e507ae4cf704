"""A spring that is not linear: H{ŷ²} and H{ŷ³}, the force that it adds as the sensor answers it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Scale, Shape, Size
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import Point, PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray


class Spring(Shape):
    """A cubic stiffness, or one that is stiffer on one side of the rest point."""

    name: ClassVar[str] = "spring"
    code: ClassVar[WarningCode] = "nonlinear"

    def shapes(self, signal: FloatArray, size: Size) -> Iterable[tuple[str, FloatArray]]:
        """Yield square and cube of the motion."""
        motion = size.scale.motion
        y = signal / motion
        yield (
            "is bent as by a spring that is stiffer on one side of its rest point",
            y * y * motion,
        )
        yield "is bent as by a spring that is not linear", y * y * y * motion

    def answer(self, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """Return the sensor's transfer function over its largest size, shape (R, K)."""
        size = np.max(np.abs(group.transfer), axis=1, keepdims=True, initial=0.0)
        return group.transfer / np.where(size > 0.0, size, 1.0)

    def at_points(self, points: PointsPart) -> list[Point]:
        """Return the describing function of a cubic stiffness: −¾ k₃ |V|² H/S₀.

        Source: Nayfeh & Mook 1979, sec. 2.3.
        """
        if points.response is None:
            return []
        effect = np.abs(points.response) ** 2 * points.transfer
        words = "is bent as by a spring that is not linear"
        return [Point(words, (effect / np.max(np.abs(effect)))[None])]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return how much the response is bent, at the largest motion."""
        size = abs(100.0 * float(score.amounts[0]))
        return f"the response {candidate.words}, {plain(size, 2)} % at the largest"


SPRING = Spring()

"""A spring that is not linear: H{ŷ²} and H{ŷ³}, the force that it adds as the sensor answers it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.part import Part
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.score import Score, Sums
from vibrident.fit.measure.response import ComplexArray


class Spring(Departure):
    """Cubic stiffness, or one that is stiffer on one side of the rest point."""

    name: ClassVar[str] = "spring"
    code: ClassVar[WarningCode] = "nonlinear"
    linear: ClassVar[bool] = False

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Square and cube of the motion, through the sensor."""
        y, size = part.motion / scale.motion, float(np.max(np.abs(part.transfer), initial=0.0))
        if size > 0.0:
            bent = part.through(np.stack([y * y, y**3])) * (scale.motion / size)
            yield "is bent as by a spring that is stiffer on one side of its rest point", bent[:1]
            yield "is bent as by a spring that is not linear", bent[1:]

    def at_points(self, points: PointsPart) -> list[tuple[Candidate, Sums]]:
        """The describing function of a cubic stiffness: −¾ k₃ |V|² H/S₀ (Nayfeh & Mook 1979, sec. 2.3)."""
        if points.response is None:
            return []
        effect = np.abs(points.response) ** 2 * points.transfer
        words = "is bent as by a spring that is not linear"
        return [points.place(words, (effect / np.max(np.abs(effect)))[None])]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """How much, at the largest motion."""
        return f"the response {candidate.words}, {plain(abs(100.0 * float(score.amounts[0])), 2)} % at the largest"


SPRING = Spring()

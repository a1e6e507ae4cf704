"""A high-pass that the model lacks: ŷ/(jω), and a slow drift of the response with its motion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import Point, PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray


class HighPass(Departure):
    """To first order in its corner frequency a high-pass takes ω₀/(jω) of the response."""

    name: ClassVar[str] = "high-pass"
    code: ClassVar[WarningCode] = "lack_of_fit"

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """The integral of the motion, per hertz of the corner frequency; a sine has one frequency."""
        if group.pull is None:
            yield "", (2j * np.pi / group.rate_hz / group.radians * group.likely)[:, None]

    def at_points(self, points: PointsPart) -> list[Point]:
        """What a high-pass does to first order."""
        return [Point("", np.asarray(1j / points.frequency_hz[None], dtype=complex))]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """The corner frequency, to first order."""
        corner = float(score.amounts[0])
        if corner < 0.0:
            return "the response rises towards low frequencies as no sensor of the model does"
        return f"the response falls towards low frequencies as behind a high-pass of about {corner:.2g} Hz"


HIGH_PASS = HighPass()

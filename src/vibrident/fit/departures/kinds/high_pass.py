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
from vibrident.physics.models.add_ons.highpass import HIGHPASS


class HighPass(Departure):
    """A high-pass, which to first order in its corner frequency takes ω₀/(jω) of the response."""

    name: ClassVar[str] = "high-pass"
    code: ClassVar[WarningCode] = "lack_of_fit"

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield the motion's integral, per hertz of corner frequency; a sine has one frequency."""
        if group.pull is None and HIGHPASS.name not in scale.add_ons:
            yield "", (2j * np.pi / group.rate_hz / group.radians * group.likely)[:, None]

    def at_points(self, points: PointsPart) -> list[Point]:
        """Return what a high-pass does to first order."""
        return [Point("", np.asarray(1j / points.frequency_hz[None], dtype=complex))]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return the corner frequency, to first order."""
        corner = float(score.amounts[0])
        if corner < 0.0:
            return "the response rises towards low frequencies as no sensor of the model does"
        return (
            "the response falls towards low frequencies "
            f"as behind a high-pass of about {corner:.2g} Hz"
        )


HIGH_PASS = HighPass()

"""A delay that the model lacks: −jω ŷ."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.warning_kinds import WarningCode
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import Point, PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray
from vibrident.physics.models.add_ons.delay import DELAY as ADD_ON_DELAY


class Delay(Departure):
    """A response that comes later, or earlier, than the model has it."""

    name: ClassVar[str] = "delay"
    code: ClassVar[WarningCode] = "lack_of_fit"

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield the slope of the motion, per second of delay; a sine has one frequency."""
        if group.pull is None and ADD_ON_DELAY.name not in scale.add_ons:
            yield "", (-1j * group.rate_hz * group.radians * group.likely)[:, None]

    def at_points(self, points: PointsPart) -> list[Point]:
        """Return a phase in proportion to the frequency."""
        return [Point("", np.asarray(-2j * np.pi * points.frequency_hz[None], dtype=complex))]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return how late the response comes."""
        late = float(score.amounts[0])
        difference = f"{amount(abs(late), 's', 2)} {'later' if late > 0.0 else 'earlier'}"
        return (
            f"the response comes {difference} than the model has it; "
            "the add-on delay has a parameter for it"
        )


DELAY = Delay()

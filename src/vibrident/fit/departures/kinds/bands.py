"""A response that the model misses: ŷ in each of eight bands, in phase and turned by a quarter."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import ClassVar

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import Point, PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray

#: Parts of the frequencies of points, and the fewest frequencies that are parted.
OF_POINTS = 4
FEWEST = 6


class Bands(Departure):
    """A complex factor of its own in each band of like information."""

    name: ClassVar[str] = "bands"
    code: ClassVar[WarningCode] = "band_sensitive"
    own_columns: ClassVar[bool] = True
    joint: ClassVar[bool] = False

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """The motion in each band; a sine has one frequency."""
        if group.pull is None:
            inside = [
                group.likely * ((group.hz >= low) & (group.hz < high))
                for low, high in pairwise(scale.bands_hz)
            ]
            yield "", np.stack([turn * own for own in inside for turn in (1.0, 1j)], axis=1)

    def at_points(self, points: PointsPart) -> list[Point]:
        """A complex factor of the points of each part of the frequencies."""
        order = np.argsort(points.frequency_hz, kind="stable")
        if len(np.unique(points.frequency_hz)) < FEWEST:
            return []
        parts = [np.isin(np.arange(order.size), some) for some in np.array_split(order, OF_POINTS)]
        return [
            Point("", np.array([turn * one for one in parts for turn in (1.0, 1j)], dtype=complex))
        ]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """That the model misses a band."""
        return "the model is not equally right over the whole band"


BANDS = Bands()

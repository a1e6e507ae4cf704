"""A record of another sensor, range or wiring: ŷ 1[record] and ŷ̇ 1[record]."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import Point, PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray

QUESTION = "Was it taken with another sensor, range or wiring?"


class OtherRecord(Departure):
    """Gain and time of one record that differ from the others'."""

    name: ClassVar[str] = "other-record"
    code: ClassVar[WarningCode] = "regimes"
    pooled: ClassVar[bool] = False
    compares_records: ClassVar[bool] = True
    family: ClassVar[str] = "change"

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield motion and slope.

        A sine has an amplitude and phase of its own, which its points compare.
        """
        if group.pull is None and scale.records > 1:
            yield "", group.gain_and_time

    def at_points(self, points: PointsPart) -> list[Point]:
        """Return a complex factor of each record's points."""
        names = dict.fromkeys(points.record)
        if len(names) < 2:
            return []
        members = [np.array([record == name for record in points.record]) for name in names]
        pairs = [np.stack([member + 0j, 1j * member]) for member in members]
        return [Point("", pair, name) for name, pair in zip(names, pairs, strict=True)]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return by how much the record differs."""
        gain = 100.0 * score.known(0)
        side = "larger" if gain > 0.0 else "smaller"
        size = f": its response is {plain(abs(gain), 2)} % {side} than they predict"
        return f"the record does not belong to the others{size if gain else ''}. {QUESTION}"


OTHER_RECORD = OtherRecord()

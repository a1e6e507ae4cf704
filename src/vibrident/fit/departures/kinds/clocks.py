"""Two clocks: t dŷ/dt."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from numpy import fft

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray


class Clocks(Departure):
    """A response that is read at t(1 + ε): a delay that grows with time."""

    name: ClassVar[str] = "clocks"
    code: ClassVar[WarningCode] = "clock_suspect"
    family: ClassVar[str] = "change"

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield the slope of the motion times the time from the middle of the record.

        What is alike at the begin and at the end is a delay.
        """
        time_s = group.time_s - 0.5 * group.records[0].duration_s
        yield "", group.bins_of(_slope(group) * time_s)[:, None]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return by how much the clocks differ."""
        offset = float(score.amounts[0])
        return (
            f"the intervals of the response are {plain(abs(offset) * 1e6, 3)} ppm "
            f"{'longer' if offset > 0.0 else 'shorter'} than those of the reference, "
            "as of two clocks"
        )


def slope_with_time(group: WhitenedGroup, origin_s: float) -> ComplexArray:
    """Return bins of dŷ/dt times the time from an origin, and of dŷ/dt, shape (R, 2, K)."""
    slope = _slope(group)
    return group.bins_of(np.stack([slope * (group.time_s - origin_s), slope], axis=1))


def _slope(group: WhitenedGroup) -> FloatArray:
    """Return dŷ/dt, shape (R, L)."""
    length = group.motion.shape[1]
    radians_a_second = 2j * np.pi * group.rate_hz / group.samples * np.arange(length // 2 + 1)
    lines = radians_a_second * fft.rfft(group.motion, axis=1)
    return np.asarray(fft.irfft(lines, length, axis=1), dtype=float)


CLOCKS = Clocks()

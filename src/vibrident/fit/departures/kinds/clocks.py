"""Two clocks: t dŷ/dt."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.part import Part
from vibrident.fit.departures.score import Score


class Clocks(Departure):
    """The response is read at t(1 + ε): a delay that grows with time."""

    name: ClassVar[str] = "clocks"
    code: ClassVar[WarningCode] = "clock_suspect"
    family: ClassVar[str] = "change"

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, FloatArray]]:
        """The slope of the motion times the time from the middle of the record.

        What is alike at the begin and at the end is a delay.
        """
        yield "", slope_with_time(part, 0.5 * part.record.duration_s)[:1]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """By how much."""
        offset = float(score.amounts[0])
        return (
            f"the intervals of the response are {plain(abs(offset) * 1e6, 3)} ppm "
            f"{'longer' if offset > 0.0 else 'shorter'} than those of the reference, as of two clocks"
        )


def slope_with_time(part: Part, origin_s: float) -> FloatArray:
    """Return dŷ/dt times the time from an origin, and dŷ/dt, shape (2, samples)."""
    slope = np.fft.irfft(part.moved_bins[1] * part.rate_hz, part.samples)
    time_s = part.begin_s - origin_s + np.arange(part.samples) / part.rate_hz
    return np.stack([slope * time_s, slope])


CLOCKS = Clocks()

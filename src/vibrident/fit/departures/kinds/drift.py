"""A zero that drifts: Legendre polynomials of time up to the fifth degree."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Scale, WithoutMotion
from vibrident.fit.departures.part import Part
from vibrident.fit.departures.score import Score

#: Highest degree.
DEGREE = 5


class Drift(WithoutMotion):
    """A smooth curve that the motion does not explain."""

    name: ClassVar[str] = "drift"
    code: ClassVar[WarningCode] = "drift"
    pooled: ClassVar[bool] = False

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, FloatArray]]:
        """The polynomials, as large as the largest motion."""
        time = np.linspace(-1.0, 1.0, part.samples)
        yield "", scale.motion * np.asarray(np.polynomial.legendre.legvander(time, DEGREE).T[1:], dtype=float)

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """How far."""
        size = 100.0 * float(np.max(np.abs(score.amounts)))
        return f"the response drifts by about {plain(size, 2)} % of its largest, which the motion does not explain"


DRIFT = Drift()

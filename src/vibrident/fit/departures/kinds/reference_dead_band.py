"""A dead band of the reference's recorder: H{sgn u}."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, OfReference, Size
from vibrident.fit.departures.score import Score


class ReferenceDeadBand(OfReference):
    """Motion around zero that the recorder of the reference leaves out, and the sensor answers."""

    name: ClassVar[str] = "reference-dead-band"
    code: ClassVar[WarningCode] = "nonlinear"

    def shapes(self, signal: FloatArray, size: Size) -> Iterable[tuple[str, FloatArray]]:
        """Yield the sign of the motion, per unit of the reference."""
        yield "", size.sign(signal)

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return how wide the dead band is."""
        size = plain(abs(float(score.amounts[0])), 2)
        return (
            f"the reference has a dead band, or a step, around its zero, of {size} in its SI unit"
        )


REFERENCE_DEAD_BAND = ReferenceDeadBand()

"""A response that was cut off: sgn ŷ max(|ŷ| − c, 0), and the same on one side."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Shape, Size

#: Levels over the largest motion: of both sides, and of one.
LEVELS = (0.5, 0.8, 0.95)
ONE_SIDED_LEVELS = (0.5, 0.9)


class ClippedResponse(Shape):
    """An amplifier or recorder at its limit."""

    name: ClassVar[str] = "clipped-response"
    code: ClassVar[WarningCode] = "clipped"

    def shapes(self, signal: FloatArray, size: Size) -> Iterable[tuple[str, FloatArray]]:
        """Yield what lies beyond each level."""
        motion = size.scale.motion
        for level in LEVELS:
            limit = level * motion
            yield _words(level, ""), signal - np.clip(signal, -limit, limit)
        for level in ONE_SIDED_LEVELS:
            for sign, side in ((1.0, " above"), (-1.0, " below")):
                yield _words(level, side), np.maximum(sign * signal - level * motion, 0.0)


def _words(level: float, side: str) -> str:
    """Return the clause on what lies beyond a level."""
    where = f"beyond {plain(100.0 * level, 2)} % of its largest{side}"
    return f"the response departs {where}, as where an amplifier is overdriven"


CLIPPED_RESPONSE = ClippedResponse()

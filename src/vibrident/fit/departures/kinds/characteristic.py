"""A bent characteristic: ŷ², ŷ³ and sgn ŷ.

Each has its quadrature, so that a delay of the shape does not matter.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Shape, Size
from vibrident.fit.departures.score import Score


class Characteristic(Shape):
    """A dead band, or Volterra kernels of second and third order without memory (Schetzen 1980)."""

    name: ClassVar[str] = "characteristic"
    code: ClassVar[WarningCode] = "nonlinear"
    turned: ClassVar[bool] = True

    def shapes(self, signal: FloatArray, size: Size) -> Iterable[tuple[str, FloatArray]]:
        """Yield square, cube and sign of the motion, over their size at the largest."""
        motion = size.scale.motion
        y = signal / motion
        yield "holds a square of the motion", y * y * motion
        yield "is bent as by a cube of the motion", y * y * y * motion
        yield "has a dead band, or a step, around its zero", size.sign(signal) * motion

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return how much the response is bent, at the largest motion."""
        size = 100.0 * float(np.hypot(*score.amounts))
        return (
            f"the response {candidate.words}, {plain(size, 2)} % at the largest; "
            "that of a linear sensor does not"
        )


CHARACTERISTIC = Characteristic()

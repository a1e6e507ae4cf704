"""A bent characteristic: ŷ², ŷ³ and sgn ŷ, each with its quadrature, so that a delay of the shape does not matter."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from numpy import fft

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.part import Part
from vibrident.fit.departures.score import Score
from vibrident.fit.measure.response import ComplexArray


class Characteristic(Departure):
    """Volterra kernels of second and third order without memory, and a dead band (Schetzen 1980)."""

    name: ClassVar[str] = "characteristic"
    code: ClassVar[WarningCode] = "nonlinear"
    linear: ClassVar[bool] = False

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Square, cube and sign of the motion, over their size at the largest."""
        y = part.motion / scale.motion
        shapes = {"holds a square of the motion": y * y, "is bent as by a cube of the motion": y**3}
        for words, shape in {**shapes, "has a dead band, or a step, around its zero": np.sign(y)}.items():
            bins = np.asarray(fft.rfft(shape * part.used)) * scale.motion
            yield words, np.stack([bins, 1j * bins])

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """How much, at the largest motion."""
        size = 100.0 * float(np.hypot(*score.amounts))
        return f"the response {candidate.words}, {plain(size, 2)} % at the largest; a linear sensor does neither"


CHARACTERISTIC = Characteristic()

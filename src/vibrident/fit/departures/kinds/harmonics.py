"""Harmonics of a sine: cos kωt and sin kωt, k = 2 to 5."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import comb
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.candidate import Candidate, Places
from vibrident.fit.departures.departure import Scale, WithoutMotion
from vibrident.fit.departures.part import Part, harmonics_of
from vibrident.fit.departures.score import Score

#: A harmonic is of the light where the response has less than this part of what the prediction leaves.
OWN = 0.5


@dataclass(frozen=True, eq=False)
class Harmonic(Candidate):
    """A harmonic; ``moved``: amounts of its columns in the prediction from an interferometer, shape (2,)."""

    moved: FloatArray | None = None

    def of_light(self, score: Score) -> bool:
        """Whether the response does not show it: the displacement has it, and the motion has not."""
        return self.moved is not None and float(np.hypot(*(self.moved + score.amounts))) < OWN * float(
            np.hypot(*score.amounts)
        )


class Harmonics(WithoutMotion):
    """What the response has at multiples of the tone beyond what the motion has there, or lacks of it."""

    name: ClassVar[str] = "harmonics"
    code: ClassVar[WarningCode] = "nonlinear"
    pooled: ClassVar[bool] = False
    joint: ClassVar[bool] = False
    of_light: ClassVar[bool] = True

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, FloatArray]]:
        """Cosine and sine of each order, as large as the motion of the part."""
        size = float(np.max(np.abs(part.motion), initial=0.0))
        if part.turns is not None and size > 0.0:
            for order, waves in enumerate(harmonics_of(part.turns, part.samples), start=2):
                yield f"{order}", size * waves

    def places(self, part: Part, scale: Scale, parameters: int) -> list[Places]:
        """Each order."""
        every = super().places(part, scale, parameters)
        if not every:
            return []
        [places] = every
        if part.pull is not None:
            own = np.stack([_of_the_tone(part, int(one.words), part.pull) for one in places.candidates])
            places = replace(places, sums=replace(places.sums, shift=places.sums.shift + own))
        if part.record.optical is None:
            return [places]
        size = 0.5 * part.samples * float(np.max(np.abs(part.motion))) ** 2
        moved = [columns @ part.predicted / size for _, columns in self.columns(part, scale)]
        both = zip(places.candidates, moved, strict=True)
        return [replace(places, candidates=tuple(Harmonic(one.words, one.number, moved=own) for one, own in both))]

    def code_of(self, candidate: Candidate, score: Score) -> WarningCode:
        """``few_fringes`` for those of an interferometer's light."""
        return "few_fringes" if isinstance(candidate, Harmonic) and candidate.of_light(score) else self.code

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """How large."""
        size = f"{plain(100.0 * float(np.hypot(*score.amounts)), 2)} % of the predicted response"
        if self.code_of(candidate, score) != self.code:
            return (
                f"the displacement has harmonics that the response does not show, {size} at {candidate.words} times "
                "the tone: the interferometer's phase has an error that repeats with the fringe (a cyclic error, or "
                "its ellipse), which so small a motion does not determine; the same error changes the amplitude of the "
                "motion itself"
            )
        return f"the sensor adds harmonics, {size} at {candidate.words} times the tone; a linear one adds none"


def _of_the_tone(part: Part, order: int, pull: FloatArray) -> FloatArray:
    """What a bent characteristic without memory that makes such a harmonic does to the parameters, shape (2, P).

    A power of odd order k adds to the tone C(k, (k − 1)/2) times its harmonic, at k times its phase.
    """
    if order % 2 == 0:
        return np.zeros((2, len(pull)))
    size = float(np.max(np.abs(part.motion), initial=0.0))
    tone = 2.0 / part.samples * part.motion @ np.exp(-2j * np.pi * (part.turns or 0.0) * np.arange(part.samples))
    turned = comb(order, (order - 1) // 2) * size / abs(tone) * np.exp(-1j * order * np.angle(tone))
    change = np.array([turned, -1j * turned])  # of log H by each column
    return np.asarray(np.stack([change.real, change.imag], axis=1) @ pull.T)


HARMONICS = Harmonics()

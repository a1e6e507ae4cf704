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
from vibrident.fit.departures.departure import Candidate, Places, Scale, WithoutMotion
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.score import Score
from vibrident.fit.departures.sums import Exact
from vibrident.fit.response.response import ComplexArray

#: A harmonic is of the light where the response has less than this part of what the prediction leaves.
OWN = 0.5


@dataclass(frozen=True, eq=False)
class Harmonic(Candidate):
    """A harmonic; ``moved``: amounts of its columns in the prediction from an interferometer, shape (2,)."""

    moved: FloatArray | None = None

    def of_light(self, score: Score) -> bool:
        """Whether the response does not show it: the displacement has it, and the motion has not."""
        return self.moved is not None and float(
            np.hypot(*(self.moved + score.amounts))
        ) < OWN * float(np.hypot(*score.amounts))


class Harmonics(WithoutMotion):
    """What the response has at multiples of the tone beyond what the motion has there, or lacks of it."""

    name: ClassVar[str] = "harmonics"
    code: ClassVar[WarningCode] = "nonlinear"
    pooled: ClassVar[bool] = False
    joint: ClassVar[bool] = False
    of_light: ClassVar[bool] = True

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Cosine and sine of each order, as large as the motion of the record."""
        if not np.isnan(group.turns).all():
            waves = _size(group)[:, None, None, None] * group.harmonics
            for order in range(waves.shape[1]):
                yield f"{order + 2}", waves[:, order]

    def places(self, group: WhitenedGroup, scale: Scale) -> list[Places]:
        """Each order that samples tell."""
        every = super().places(group, scale)
        return [replace(one, there=np.any(one.sums.gram != 0.0, axis=(2, 3))) for one in every]

    def refined(
        self, candidate: Candidate, group: WhitenedGroup, scale: Scale, sums: Exact
    ) -> tuple[Candidate, Exact]:
        """Add what a characteristic that makes it does to the parameters; of light, what the light has of it."""
        order = int(candidate.words)
        if group.pull is not None:
            sums = replace(sums, shift=sums.shift + _of_the_tone(group, order))
        if group.records[0].optical is None:
            return candidate, sums
        waves = group.harmonics[0, order - 2]
        moved = (
            4.0 / group.samples**2 / _size(group)[0] * np.real(waves.conj() @ group.predicted[0])
        )
        return Harmonic(candidate.words, candidate.number, moved=moved), sums

    def code_of(self, candidate: Candidate, score: Score) -> WarningCode:
        """``few_fringes`` for those of an interferometer's light."""
        return (
            "few_fringes"
            if isinstance(candidate, Harmonic) and candidate.of_light(score)
            else self.code
        )

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


def _size(group: WhitenedGroup) -> FloatArray:
    """Largest motion of each record, shape (R,)."""
    return np.asarray(np.max(np.abs(group.motion), axis=1, initial=0.0))


def _of_the_tone(group: WhitenedGroup, order: int) -> FloatArray:
    """What a bent characteristic without memory that makes such a harmonic does to the parameters, shape (R, 2, P).

    A power of odd order k adds to the tone C(k, (k − 1)/2) times its harmonic, at k times its phase.
    """
    assert group.pull is not None
    turned = np.zeros(len(group.records), dtype=complex)
    if order % 2:
        step = group.samples // group.motion.shape[1]
        angle = 2.0 * np.pi * step * group.turns[:, None] * np.arange(group.motion.shape[1])
        tone = 2.0 / group.motion.shape[1] * np.sum(group.motion * np.exp(-1j * angle), axis=1)
        phase = np.exp(-1j * order * np.angle(tone))
        turned = comb(order, (order - 1) // 2) * _size(group) / np.abs(tone) * phase
    change: ComplexArray = np.stack([turned, -1j * turned], axis=1)  # of log H by each column
    return np.stack([change.real, change.imag], axis=2) @ group.pull.mT


HARMONICS = Harmonics()

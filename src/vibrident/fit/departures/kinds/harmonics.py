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
from vibrident.fit.departures.sums import ExactSums
from vibrident.fit.response.response import ComplexArray

#: A harmonic is of the light where the response has less than this part of what the prediction
#: leaves.
MAX_RESPONSE_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Harmonic(Candidate):
    """A harmonic of a sine.

    ``predicted_amounts``: of its columns in the prediction from an interferometer, shape (2,).
    """

    predicted_amounts: FloatArray | None = None

    def of_light(self, score: Score) -> bool:
        """Return whether the displacement has it and neither response nor motion does."""
        return self.predicted_amounts is not None and float(
            np.hypot(*(self.predicted_amounts + score.amounts))
        ) < MAX_RESPONSE_SHARE * float(np.hypot(*score.amounts))


class Harmonics(WithoutMotion):
    """Tones of the response at multiples of the excitation, beyond those of the motion."""

    name: ClassVar[str] = "harmonics"
    code: ClassVar[WarningCode] = "nonlinear"
    pooled: ClassVar[bool] = False
    joint: ClassVar[bool] = False
    of_light: ClassVar[bool] = True

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield cosine and sine of each order, as large as the motion of the record."""
        waves = _largest_motion(group)[:, None, None, None] * group.harmonics
        for order in range(waves.shape[1]):
            yield f"{order + 2}", waves[:, order]

    def places(self, group: WhitenedGroup, scale: Scale) -> list[Places]:
        """Return each order that samples tell."""
        places = super().places(group, scale)
        return [
            replace(places_of_width, present=np.any(places_of_width.sums.gram != 0.0, axis=(2, 3)))
            for places_of_width in places
        ]

    def refined(
        self, candidate: Candidate, group: WhitenedGroup, scale: Scale, sums: ExactSums
    ) -> tuple[Candidate, ExactSums]:
        """Return the harmonic with what a characteristic that makes it does to the parameters.

        Of an interferometer's light it holds the amounts in the prediction, too.
        """
        order = int(candidate.words)
        if group.pull is not None:
            sums = replace(sums, shift=sums.shift + _shift_by_characteristic(group, order))
        if group.records[0].optical is None:
            return candidate, sums
        waves = group.harmonics[0, order - 2]
        predicted_amounts = (
            4.0
            / group.samples**2
            / _largest_motion(group)[0]
            * np.real(waves.conj() @ group.predicted[0])
        )
        return Harmonic(
            candidate.words, candidate.number, predicted_amounts=predicted_amounts
        ), sums

    def code_of(self, candidate: Candidate, score: Score) -> WarningCode:
        """Return ``few_fringes`` for harmonics of an interferometer's light."""
        return (
            "few_fringes"
            if isinstance(candidate, Harmonic) and candidate.of_light(score)
            else self.code
        )

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return how large the harmonic is."""
        size = f"{plain(100.0 * float(np.hypot(*score.amounts)), 2)} % of the predicted response"
        if self.code_of(candidate, score) != self.code:
            return (
                "the displacement has harmonics that the response does not show, "
                f"{size} at {candidate.words} times the tone: the interferometer's phase has an "
                "error that repeats with the fringe (a cyclic error, or its ellipse), which so "
                "small a motion does not determine; the same error changes the amplitude of the "
                "motion itself"
            )
        return (
            f"the sensor adds harmonics, {size} at {candidate.words} times the tone; "
            "a linear one adds none"
        )


def _largest_motion(group: WhitenedGroup) -> FloatArray:
    """Return the largest motion of each record, shape (R,)."""
    return np.asarray(np.max(np.abs(group.motion), axis=1, initial=0.0))


def _shift_by_characteristic(group: WhitenedGroup, order: int) -> FloatArray:
    """Return how far a bent characteristic that makes such a harmonic moves the parameters.

    Its shape is (R, 2, P). A power of odd order k adds to the tone C(k, (k − 1)/2) times its
    harmonic, at k times its phase; it has no memory.
    """
    assert group.pull is not None
    relative_change = np.zeros(len(group.records), dtype=complex)
    if order % 2:
        step = group.samples // group.motion.shape[1]
        angle = 2.0 * np.pi * step * group.turns[:, None] * np.arange(group.motion.shape[1])
        tone = 2.0 / group.motion.shape[1] * np.sum(group.motion * np.exp(-1j * angle), axis=1)
        phase = np.exp(-1j * order * np.angle(tone))
        relative_change = (
            comb(order, (order - 1) // 2) * _largest_motion(group) / np.abs(tone) * phase
        )
    change: ComplexArray = np.stack(
        [relative_change, -1j * relative_change], axis=1
    )  # of log H by each column
    return np.stack([change.real, change.imag], axis=2) @ group.pull.mT


HARMONICS = Harmonics()

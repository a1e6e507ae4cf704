"""A sensor that changes within a record: ŷ 1[t ≥ τ], ŷ̇ 1[t ≥ τ] and J 1[t ≥ τ], or ŷ t and ŷ̇ t."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.candidate import Candidate, Places
from vibrident.fit.departures.departure import Departure, Scale, edges_of, factors_of, in_steps
from vibrident.fit.departures.part import Part
from vibrident.fit.departures.score import Score, Sums

#: Places in a record.
BLOCKS = 32
#: Part of the motion's power on either side of a step (Andrews 1993, sec. 4).
LEAST = 0.15
GAIN, CHANNEL, SENSOR = "gain", "gain and time", "sensor"


class Change(Departure):
    """A step of gain, of gain and time, or of the whole sensor at the worst of the places, or an even change."""

    name: ClassVar[str] = "change"
    code: ClassVar[WarningCode] = "regimes"
    pooled: ClassVar[bool] = False
    family: ClassVar[str] = "change"
    within: ClassVar[bool] = True
    approximate: ClassVar[bool] = True

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, FloatArray]]:
        """By sums over blocks instead."""
        return ()

    def places(self, part: Part, scale: Scale, parameters: int) -> list[Places]:
        """Steps with enough of the motion on either side, and the ramp."""
        changes = in_steps(part, BLOCKS, parameters)
        steps = np.flatnonzero((changes.behind > LEAST) & (changes.behind < 1.0 - LEAST)).tolist()
        numbers, times = [*steps, BLOCKS - 1], [*changes.time_s[steps].tolist(), None]
        sets = [GAIN, CHANNEL] if len(part.changing) <= 2 else [GAIN, CHANNEL, SENSOR]
        return [
            Places(
                tuple(Candidate(words, number, time) for number, time in zip(numbers, times, strict=True)),
                changes.sums.at(numbers).some(_kept(words, part)),
            )
            for words in sets
        ]

    def columns_of(self, candidate: Candidate, part: Part, scale: Scale) -> FloatArray:
        """Those of a place."""
        bins = part.changing_bins[_kept(candidate.words, part)]
        return np.asarray(np.fft.irfft(bins, part.samples, axis=-1) * _factor(candidate, part))

    def whitened(self, candidate: Candidate, part: Part, scale: Scale) -> FloatArray:
        """The factor times the whitened columns.

        A step of the columns themselves counts most in the quietest bins, and is half a block misplaced at worst. A
        sine has them so nevertheless: its whitening filter rings for as long as the record.
        """
        if part.turns is not None:
            return part.white(self.columns_of(candidate, part, scale))
        return part.freed(part.changing[_kept(candidate.words, part)] * _factor(candidate, part))

    def exact(self, candidate: Candidate, part: Part, scale: Scale, parameters: int) -> Sums:
        """Of the whitened columns."""
        share, rows = float(np.mean(_factor(candidate, part))), part.changing[_kept(candidate.words, part)]
        doubt = share * part.in_common(rows)[:, -1]
        return Sums.of(part, self.whitened(candidate, part, scale), parameters, doubt)

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """What changed, and by how much."""
        time_s = candidate.time_s
        when = "changes evenly over the record" if time_s is None else f"changed at about {plain(time_s, 4)} s"
        if candidate.words == SENSOR:
            return f"the sensor {when}"
        gain, than = float(score.amounts[0]), "at the end than at the begin" if time_s is None else "than before"
        size = f"{plain(abs(100.0 * gain), 2)} % {'larger' if gain > 0.0 else 'smaller'}"
        words = f"the sensor {when}: its response is {size} {than}"
        if candidate.words == CHANNEL:
            later = -float(score.amounts[1])
            words += f" and comes {amount(abs(later), 'samples', 2)} {'later' if later > 0.0 else 'earlier'}"
        return words


def _kept(words: str, part: Part) -> list[int]:
    """Which of :attr:`Part.changing`."""
    return {GAIN: [0], CHANNEL: [0, 1]}.get(words, list(range(1, len(part.changing))))


def _factor(candidate: Candidate, part: Part) -> FloatArray:
    """Of each sample, shape (n,)."""
    return np.repeat(factors_of(BLOCKS)[candidate.number], np.diff(edges_of(part.samples, BLOCKS)))


CHANGE = Change()

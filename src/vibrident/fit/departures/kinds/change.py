"""A sensor that changes within a record: ŷ 1[t ≥ τ], ŷ̇ 1[t ≥ τ] and J 1[t ≥ τ], or ŷ t and ŷ̇ t."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Departure, InTime, Scale, in_steps
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

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, FloatArray]]:
        """By sums over blocks instead."""
        return ()

    def candidates(self, part: Part, scale: Scale, parameters: int) -> list[Candidate]:
        """All places of a part."""
        found = []
        for each in in_steps(part, BLOCKS, parameters):
            if not LEAST < each.behind < 1.0 - LEAST:
                continue
            sets = {GAIN: [0], CHANNEL: [0, 1]}
            if each.time_s is not None and len(each.sums.score) > 2:
                sets[SENSOR] = list(range(1, len(each.sums.score)))
            for words, kept in sets.items():
                exactly = partial(_exactly, part, each, kept, words, parameters)
                found.append(Candidate(words, each.sums.some(kept), time_s=each.time_s, exactly=exactly))
        return found

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


def _exactly(part: Part, change: InTime, kept: Sequence[int], words: str, parameters: int) -> Candidate:
    white = part.white(part.changing[kept] * np.repeat(change.factor, np.diff(change.edges)))
    return Candidate(words, Sums.of(part, white, parameters), lambda: (white,), change.time_s)


CHANGE = Change()

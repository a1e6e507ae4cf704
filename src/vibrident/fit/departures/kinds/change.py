"""A sensor that changes within a record: ŷ 1[t ≥ τ], ŷ̇ 1[t ≥ τ], J 1[t ≥ τ], or ŷ t and ŷ̇ t."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Departure, Places, Scale
from vibrident.fit.departures.group import BLOCKS, WhitenedGroup
from vibrident.fit.departures.rows import without
from vibrident.fit.departures.score import Score
from vibrident.fit.departures.sums import ExactSums
from vibrident.fit.response.response import ComplexArray

#: Part of the motion's power on either side of a step (Andrews 1993, sec. 4).
MIN_MOTION_SHARE = 0.15
#: Columns that sums over blocks approximate tell nothing where the parameters leave less than this
#: part, in squares.
MIN_UNFOLLOWED_BY_BLOCKS = 1e-2
#: What changes, by which columns.
GAIN = "gain"
CHANNEL = "gain and time"
SENSOR = "sensor"
#: Factors of each step, and of the ramp, in each block: zero at the begin, as parameters are those
#: before a change.
FACTORS = np.concatenate([np.tri(BLOCKS).T[1:], [(np.arange(BLOCKS) + 0.5) / BLOCKS]])


class Change(Departure):
    """A step of gain, of gain and time, or of the whole sensor at the worst place, or a ramp."""

    name: ClassVar[str] = "change"
    code: ClassVar[WarningCode] = "regimes"
    pooled: ClassVar[bool] = False
    family: ClassVar[str] = "change"
    within: ClassVar[bool] = True

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Return none: the places are tested by sums over blocks instead."""
        return ()

    def places(self, group: WhitenedGroup, scale: Scale) -> list[Places]:
        """Return steps with enough of the motion on either side, and the ramp, by sums over blocks.

        Whitening and a slow factor commute but for the whitening filter's length, so that one
        transform serves all places (sup over places: Andrews 1993).
        """
        records = len(group.records)
        in_blocks = records, -1, BLOCKS, group.length // BLOCKS
        gain_and_time = group.whitened_in_time(_gain_and_time_rows(group))
        signals = np.concatenate(
            [
                rows.reshape(in_blocks).swapaxes(1, 2)
                for rows in (gain_and_time, group.comparison_in_time)
            ],
            axis=2,
        )
        compared = list(range(2, signals.shape[2]))
        changing = [0, 1]
        if not _are_tones(group):  # the Jacobian, the last of what columns are compared with
            changing += compared[-group.jacobian.shape[1] :]
        columns = len(changing)
        products = (signals @ signals.mT)[:, :, changing][..., changing + compared]
        products = products.reshape(records, BLOCKS, -1)
        once = (FACTORS @ products).reshape(records, BLOCKS, columns, -1)[..., columns:]
        squared = (FACTORS**2 @ products).reshape(records, BLOCKS, columns, -1)[..., :columns]
        share_behind = FACTORS[:-1] @ products[:, :, :1]
        share_behind = share_behind[..., 0] / np.maximum(
            np.sum(products[:, :, 0], axis=1, keepdims=True), np.finfo(float).tiny
        )
        present = np.ones((records, BLOCKS), dtype=bool)
        present[:, :-1] = (share_behind > MIN_MOTION_SHARE) & (
            share_behind < 1.0 - MIN_MOTION_SHARE
        )
        sums = group.sums_of_products(once, squared)
        sums = replace(
            sums, least=MIN_UNFOLLOWED_BY_BLOCKS * np.diagonal(squared, axis1=2, axis2=3)
        )
        time_s = (np.arange(1, BLOCKS) * (group.samples / BLOCKS / group.rate_hz)).tolist()
        sets = [GAIN, CHANNEL] if columns <= 2 else [GAIN, CHANNEL, SENSOR]
        return [
            Places(
                tuple(
                    Candidate(words, number, time) for number, time in enumerate([*time_s, None])
                ),
                sums.of_columns(_column_numbers(words, columns)),
                present,
            )
            for words in sets
        ]

    def columns_of(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """Return the columns of a place by bins, shape (R, m, K)."""
        bins = (
            group.gain_and_time
            if _are_tones(group)
            else np.concatenate([group.gain_and_time, group.slopes], axis=1)
        )
        rows = np.ascontiguousarray(bins[:, _column_numbers(candidate.words, bins.shape[1])]).view(
            float
        )
        return self._times_factor(rows, candidate, group).view(complex)

    def whitened(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return the factor times the whitened columns, shape (R, m, 2 K).

        A step of the columns themselves counts most in the quietest bins, and is half a block
        misplaced at worst. A sine has them so nevertheless: its whitening filter rings for as long
        as the record.
        """
        if _are_tones(group):
            return group.whiten(self.columns_of(candidate, group, scale))
        rows = _changing_rows(group)
        return self._times_factor(
            rows[:, _column_numbers(candidate.words, rows.shape[1])], candidate, group
        )

    def _times_factor(
        self, rows: FloatArray, candidate: Candidate, group: WhitenedGroup
    ) -> FloatArray:
        """Return whitened rows times the factor of a place in time."""
        factor = np.repeat(FACTORS[candidate.number], group.length // BLOCKS)
        return group.whitened_at_bins(group.whitened_in_time(rows) * factor)

    def doubt(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return the doubt of the columns, over the part of the record that they fill, (R, m).

        Noise is in all of the record.
        """
        rows = _changing_rows(group)
        rows = rows[:, _column_numbers(candidate.words, rows.shape[1])]
        return (
            float(np.mean(FACTORS[candidate.number]))
            * (rows @ group.errors.effects[:, -1:].mT)[..., 0]
        )

    def refined(
        self, candidate: Candidate, group: WhitenedGroup, scale: Scale, sums: ExactSums
    ) -> tuple[Candidate, ExactSums]:
        """Return the place with its time in the record, of which the group may hold a piece."""
        begin = float(group.begin_s[0])
        return replace(
            candidate, time_s=None if candidate.time_s is None else candidate.time_s + begin
        ), sums

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return what changed, and by how much."""
        time_s = candidate.time_s
        when = (
            "changes evenly over the record"
            if time_s is None
            else f"changed at about {plain(time_s, 4)} s"
        )
        if candidate.words == SENSOR:
            return f"the sensor {when}"
        compared_with = "at the end than at the begin" if time_s is None else "than before"
        gain = score.known(0)
        changes = list[str]()
        if gain:
            size = f"{plain(abs(100.0 * gain), 2)} % {'larger' if gain > 0.0 else 'smaller'}"
            changes.append(f"is {size} {compared_with}")
        if candidate.words == CHANNEL and score.known(1):
            later = -score.known(1)
            changes.append(
                f"comes {amount(abs(later), 'samples', 2)} {'later' if later > 0.0 else 'earlier'}"
            )
        return f"the sensor {when}" + (f": its response {' and '.join(changes)}" if changes else "")


def _are_tones(group: WhitenedGroup) -> bool:
    """Return whether the records are sines: amplitude and phase say it all."""
    return not bool(np.isnan(group.turns).any())


def _changing_rows(group: WhitenedGroup) -> FloatArray:
    """Return what a change adds to the response, whitened, shape (R, 2 + P, 2 K).

    It is the motion, its slope and the Jacobian; of sines amplitude and phase say it all: shape (R,
    2, 2 K). In time it is determined from these: a jump of the response itself is in all bins, the
    quietest above all, and says no more than where exactly it is.
    """
    rows = _gain_and_time_rows(group)
    return rows if _are_tones(group) else np.concatenate([rows, group.jacobian], axis=1)


def _gain_and_time_rows(group: WhitenedGroup) -> FloatArray:
    """Return motion and slope, whitened and free of all nuisances but the tone: it changes."""
    return without(group.whiten(group.gain_and_time), group.basis)


def _column_numbers(words: str, size: int) -> list[int]:
    """Return which of the columns change."""
    return {GAIN: [0], CHANNEL: [0, 1]}.get(words, list(range(1, size)))


CHANGE = Change()

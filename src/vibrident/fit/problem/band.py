"""All groups of a problem: its segments at the bins of the band, and its network over them."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.group.group import Grid, Group, in_batches
from vibrident.fit.group.network import Step
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.problem.coordinates import MAX_EXPONENT
from vibrident.fit.problem.network_problem import BAND_MARGIN, MIN_BINS
from vibrident.physics.models import SensorModel

#: Fraction of a bin by which a place may miss that bin in the last digits, in other units of time.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Band:
    """Segments of a problem at the bins of the band.

    Attributes:
        problem: the segments, with inputs at a delay.
        top_hz: highest frequency of the motion; infinite where it is not known.
        tones: tones that no motion causes, in bins, of every segment.
        edges: whether the slopes of the initial states over the record are nuisances, too.
        unseen: sampling rates below twice the frequency of the free motion. It was not recorded
            there, and the initial states hold noise: edges are nuisances.
        full_band: whether every bin counts that counts in time, and no drift is a nuisance.
    """

    problem: BinProblem
    top_hz: float
    tones: tuple[tuple[float, ...], ...] = ()
    edges: bool = False
    unseen: frozenset[float] = frozenset()
    full_band: bool = False

    @property
    def model(self) -> SensorModel:
        """Return the sensor model."""
        return self.problem.frame.model

    @functools.cached_property
    def groups(self) -> tuple[Group, ...]:
        """Return segments of one length and rate side by side, as many as stay in the cache."""
        alike: dict[Grid, list[int]] = {}
        for number in range(len(self.problem.segments)):
            alike.setdefault(self._grid_of(number), []).append(number)
        groups = []
        for grid, numbers in alike.items():
            for rows in in_batches(len(numbers), grid.bins):
                group_numbers = numbers[rows]
                segments = [self.problem.segments[number] for number in group_numbers]
                groups.append(Group.from_segments(grid, group_numbers, segments))
        return tuple(groups)

    def _grid_of(self, number: int) -> Grid:
        """Return the bins of a segment that count, and its nuisances."""
        if self.full_band:
            return self.problem.grid_of(number)
        segment = self.problem.segments[number]
        record = self.problem.records[segment.record]
        rate_hz = record.sampling_rate_hz
        highest = min(self.problem.highest * rate_hz, BAND_MARGIN * self.top_hz)
        all_bins = segment.samples // 2 + 1
        last = int(highest / rate_hz * segment.samples + ROUNDING) + 1
        last_in_band = int(self.problem.highest * segment.samples + ROUNDING) + 1
        last = min(max(last, MIN_BINS), last_in_band, all_bins)
        first = 1
        if record.band_hz is not None:
            low, high = (edge / rate_hz * segment.samples for edge in record.band_hz)
            first = max(int(np.ceil(low - ROUNDING)), 1)
            last = max(int(min(last, high + ROUNDING + 1.0)), first + 1)
        fraction = float(self.problem.fractions[segment.record])
        tones = self.tones[number] if self.tones else segment.hum
        has_gaps = segment.used is not None
        bins = all_bins if has_gaps else last
        driven = record.reference is not None
        # The slopes of its states are all the information of a free decay.
        edges = (self.edges or rate_hz in self.unseen) and driven
        return Grid(
            segment.samples,
            rate_hz,
            fraction,
            bins,
            last,
            tones,
            edges,
            has_gaps,
            driven,
            first=first,
            aliased=rate_hz in self.unseen,
        )

    def within(self, top_hz: float) -> Band:
        """Return the band up to another frequency of the motion, Hz."""
        return replace(self, top_hz=top_hz)

    def with_nuisances(self, tones: Sequence[tuple[float, ...]], *, edges: bool) -> Band:
        """Return the band with tones of each segment, in bins; itself where nothing changes."""
        present = self.tones or tuple(segment.hum for segment in self.problem.segments)
        if tuple(tones) == present and edges == self.edges:
            return self
        return replace(self, tones=tuple(tones), edges=edges)

    def at_delay_of(self, values: Mapping[str, float]) -> Band:
        """Return the band with inputs at the delay of ``values``; itself where they nearly are."""
        moved = self.problem.at_delay_of(values)
        if moved is self.problem:
            return self
        return replace(self, problem=moved, tones=self._tones_in(moved))

    def _tones_in(self, problem: BinProblem) -> tuple[tuple[float, ...], ...]:
        """Return the tones of the segments of another problem, those of a record's first segment.

        Another delay may divide a record into other segments.
        """
        sizes = [
            [(segment.record, segment.samples) for segment in segments]
            for segments in (self.problem.segments, problem.segments)
        ]
        if not self.tones or sizes[0] == sizes[1]:
            return self.tones
        per_sample: dict[int, list[float]] = {}
        for (record, samples), tones in zip(sizes[0], self.tones, strict=True):
            per_sample.setdefault(record, [tone / samples for tone in tones])
        return tuple(
            tuple(turns * samples for turns in per_sample.get(record, ()))
            for record, samples in sizes[1]
        )

    def at_factors_of(self, values: Mapping[str, float]) -> Band:
        """Return the band with inputs filtered by the factors of ``values``; the samples stay."""
        moved = self.problem.at_factors_of(values)
        return self if moved is self.problem else replace(self, problem=moved)

    def at_ringing_of(self, values: Mapping[str, float]) -> Band:
        """Return the band with the sampling rates that miss the free motion at ``values``.

        Itself where these are unchanged.
        """
        lowest_hz = self.problem.lowest_ringing_hz(dict(values))
        rates = {group.grid.rate_hz for group in self.groups}
        unseen = frozenset(rate for rate in rates if lowest_hz > 0.5 * rate)
        return self if unseen == self.unseen else replace(self, unseen=unseen)

    def steps(
        self, values: dict[str, float], *, slopes: bool
    ) -> dict[tuple[float, float], Step] | None:
        """Return the steps of the network by sampling interval and fraction.

        None where a state grows beyond all numbers over its segment, as with Euler's method.
        """
        trained = self.problem.trained
        steps: dict[tuple[float, float], Step] = {}
        for group in self.groups:
            if group.step in steps:
                continue
            arguments = values, *group.step, self.problem.frame.delay_s
            step = (
                Step(*trained.with_slopes(*arguments))
                if slopes
                else Step(trained.transfer(*arguments))
            )
            if not self.is_stable(step.transfer.denominator, group.step):
                return None
            steps[group.step] = step
        return steps

    def is_stable(self, denominator: FloatArray, kind: tuple[float, float]) -> bool:
        """Return whether no state grows beyond all numbers over the longest segment of a step."""
        if not np.all(np.isfinite(denominator)):
            return False
        longest = max(group.grid.samples for group in self.groups if group.step == kind)
        poles = 1.0 + np.roots(denominator[::-1])
        growth = np.log(np.max(np.abs(poles), initial=1.0))
        return bool(growth * longest <= MAX_EXPONENT)

    def owners(self, group: Group) -> list[int]:
        """Return the record index of each segment."""
        return [self.problem.segments[number].record for number in group.segments]

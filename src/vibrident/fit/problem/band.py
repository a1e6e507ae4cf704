"""All groups of a problem: its segments at the bins of the band, and its network over them."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.group.group import Grid, Group, in_parts
from vibrident.fit.group.network import Step
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.problem.coordinates import FARTHEST
from vibrident.physics.models import SensorModel

#: Bins up to this many times the highest frequency of the motion count: beyond, a misfit that
#: motion makes and the level of the noise are seen, and nothing else.
BAND_MARGIN = 1.5
#: Bins at least, where there are so many: fewer do not tell the noise.
MIN_BINS = 256
#: Part of a bin by which a place may miss that bin in the last digits, in other units of time.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Band:
    """The segments of a problem at the bins of the band.

    Attributes:
        problem: the segments, with inputs at a delay.
        top_hz: highest frequency of the motion; infinite where it is not known.
        tones: tones that no motion causes, in bins, of every segment.
        edges: whether the initial states' slopes over the record are nuisances, too.
        unseen: sampling rates below twice the frequency of the free motion. It was not recorded
            there, and the initial states hold noise: edges are nuisances.
        whole: whether all counts that counts in time, and no drift is a nuisance.
    """

    problem: BinProblem
    top_hz: float
    tones: tuple[tuple[float, ...], ...] = ()
    edges: bool = False
    unseen: frozenset[float] = frozenset()
    whole: bool = False

    @property
    def model(self) -> SensorModel:
        """The sensor model."""
        return self.problem.frame.model

    @functools.cached_property
    def groups(self) -> tuple[Group, ...]:
        """Segments of one length and rate side by side, as many as stay in the cache."""
        alike: dict[Grid, list[int]] = {}
        for number in range(len(self.problem.segments)):
            alike.setdefault(self._grid_of(number), []).append(number)
        groups = []
        for grid, numbers in alike.items():
            for rows in in_parts(len(numbers), grid.bins):
                part = numbers[rows]
                segments = [self.problem.segments[number] for number in part]
                groups.append(Group.from_segments(grid, part, segments))
        return tuple(groups)

    def _grid_of(self, number: int) -> Grid:
        if self.whole:
            return self.problem.grid_of(number)
        segment = self.problem.segments[number]
        record = self.problem.records[segment.record]
        rate_hz = record.sampling_rate_hz
        highest = min(self.problem.highest * rate_hz, BAND_MARGIN * self.top_hz)
        every = segment.samples // 2 + 1
        last = int(highest / rate_hz * segment.samples + ROUNDING) + 1
        beyond = int(self.problem.highest * segment.samples + ROUNDING) + 1
        last = min(max(last, MIN_BINS), beyond, every)
        first = 1
        if record.band_hz is not None:
            low, high = (edge / rate_hz * segment.samples for edge in record.band_hz)
            first = max(int(np.ceil(low - ROUNDING)), 1)
            last = max(int(min(last, high + ROUNDING + 1.0)), first + 1)
        fraction = float(self.problem.fractions[segment.record])
        tones = self.tones[number] if self.tones else segment.hum
        pieces = segment.used is not None
        bins = every if pieces else last
        driven = record.reference is not None
        edges = (
            self.edges or rate_hz in self.unseen
        ) and driven  # slopes of its states are all that a free decay tells
        return Grid(
            segment.samples,
            rate_hz,
            fraction,
            bins,
            last,
            tones,
            edges,
            pieces,
            driven,
            first=first,
        )

    def within(self, top_hz: float) -> Band:
        """Return the same up to another frequency of the motion, Hz."""
        return replace(self, top_hz=top_hz)

    def beside(self, tones: Sequence[tuple[float, ...]], *, edges: bool) -> Band:
        """Return the same beside tones of each segment, in bins; itself where nothing changes."""
        if tuple(tones) == self.tones and edges == self.edges:
            return self
        return replace(self, tones=tuple(tones), edges=edges)

    def at_delay_of(self, values: Mapping[str, float]) -> Band:
        """Return the same with inputs at the delay of ``values``; itself where they nearly are."""
        moved = self.problem.at_delay_of(values)
        return self if moved is self.problem else replace(self, problem=moved)

    def at_factors_of(self, values: Mapping[str, float]) -> Band:
        """Return the same with inputs behind the factors of ``values``, over the same samples."""
        moved = self.problem.at_factors_of(values)
        return self if moved is self.problem else replace(self, problem=moved)

    def beside_ringing(self, values: Mapping[str, float]) -> Band:
        """Return the same where free motion is seen as ``values`` say; itself where that is so."""
        lowest_hz = self.problem.lowest_ringing_hz(dict(values))
        rates = {group.grid.rate_hz for group in self.groups}
        unseen = frozenset(rate for rate in rates if lowest_hz > 0.5 * rate)
        return self if unseen == self.unseen else replace(self, unseen=unseen)

    def steps(
        self, values: dict[str, float], *, slopes: bool
    ) -> dict[tuple[float, float], Step] | None:
        """Return the network's steps by sampling interval and fraction.

        None where a state grows beyond all numbers over its segment, as Euler's may.
        """
        trained = self.problem.trained
        steps: dict[tuple[float, float], Step] = {}
        for group in self.groups:
            if group.step in steps:
                continue
            at = values, *group.step, self.problem.frame.delay_s
            step = Step(*trained.with_slopes(*at)) if slopes else Step(trained.transfer(*at))
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
        return bool(growth * longest <= FARTHEST)

    def owners(self, group: Group) -> list[int]:
        """Return the number of each segment's record."""
        return [self.problem.segments[number].record for number in group.segments]

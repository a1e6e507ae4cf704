"""One quantity over a sensor's life: the valid calibrations, the shared part of their errors, and the series."""

from __future__ import annotations

import datetime
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.lab.history.drift import Drift
from vibrident.use.comparison import (
    COVERAGE_FACTOR,
    assumed_sources,
    normalized_error,
    shared_covariance,
    stated_sources,
)

DAYS_A_YEAR = 365.25
STEP_AT_REPAIR = 0.05  # probability below which a step at a repair begins a new series
STEP_UNTOLD = (
    1e-3  # probability, over all calibrations of a sensor without a jump, that a jump is reported
)
_MOST_SHARED = (
    1.0 - 1e-9
)  # largest shared part of a value's variance: rounding must not make the remainder negative


class Entry(NamedTuple):
    """One quantity of one calibration; a tuple, because a store gives ten thousand at a time."""

    id: int  # number of the calibration in the store
    date: datetime.date  # of the calibration
    value: float | None  # in the quantity's unit; None if the result has no value
    u: float | None  # standard uncertainty, same unit; None if not stated
    unit: str  # of both
    frequency_hz: float | None = None  # if the quantity is a sensitivity at a frequency
    # standard uncertainty, same unit, of each source that other calibrations may share
    shared: Mapping[str, float] = MappingProxyType({})
    data_files: str = "[]"  # hashes of its data files, a JSON list
    standing: str = ""  # the newest of ``approved``, ``superseded``, ``recalled``; else empty
    facts: Mapping[str, object] = MappingProxyType({})  # further columns of the calibration

    @property
    def u_own(self) -> float | None:
        """Standard uncertainty without the sources that other calibrations may share."""
        if self.u is None:
            return None
        return math.sqrt(max(self.u**2 - sum(u**2 for u in self.shared.values()), 0.0))


@dataclass(frozen=True)
class Event:
    """An event of a sensor, or of one of its calibrations."""

    id: int
    kind: str
    date: datetime.date
    calibration_id: int | None = None
    by: str = ""
    note: str = ""
    recorded: str = ""


@dataclass(frozen=True)
class Agreement:
    """E_n of a calibration and the one before it."""

    ordinary: float | None  # as if both were independent; None if there is no uncertainty
    correlated: float | None  # without the shared sources in the uncertainty of their difference
    # the same, but for sources that no instrument identifies: these are taken as new each time
    identified: float | None
    assumed: tuple[str, ...]  # the words of those sources
    correlation: float  # of the two values


@dataclass(frozen=True)
class Break:
    """The beginning of a new series: the index of its first calibration, and the reason in words."""

    index: int
    why: str


@dataclass(frozen=True, eq=False)
class Life:
    """The valid calibrations of a sensor, in the order of their dates, and the others."""

    entries: tuple[Entry, ...]  # with value and uncertainty, in one unit, no two of the same data
    left_out: tuple[tuple[Entry, str], ...]  # entry and reason, in words
    events: tuple[Event, ...]  # in the order of their dates

    @cached_property
    def years(self) -> FloatArray:
        """Time of each calibration from the first, in years of 365.25 days."""
        return np.array([years_between(self.entries[0].date, entry.date) for entry in self.entries])

    @cached_property
    def value(self) -> FloatArray:
        """Shape (n,)."""
        return np.array([entry.value for entry in self.entries], dtype=float)

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the errors of the calibrations, shape (n, n)."""
        return np.array([[covariance(a, b) for b in self.entries] for a in self.entries])

    @cached_property
    def identified_covariance(self) -> FloatArray:
        """Of the errors where only sources that an instrument identifies are shared, shape (n, n)."""
        few = [entry._replace(shared=stated_sources(entry.shared)) for entry in self.entries]
        return np.array([[covariance(a, b) for b in few] for a in few])

    @cached_property
    def assumed(self) -> tuple[str, ...]:
        """The words of the sources that neighbours in time share by assumption."""
        pairs = itertools.pairwise(self.entries)
        words = (assumed_sources(one.shared, other.shared) for one, other in pairs)
        return tuple(dict.fromkeys(itertools.chain.from_iterable(words)))

    @cached_property
    def breaks(self) -> tuple[Break, ...]:
        """The beginning of each series but the first."""
        found: list[Break] = []
        for index in self._repaired():
            if self._step_probability(found, index) < STEP_AT_REPAIR:
                found.append(Break(index, "repaired, and the value stepped"))
        while (untold := self._untold(found)) is not None:
            found.append(untold)
        return tuple(sorted(found, key=lambda item: item.index))

    def _repaired(self) -> list[int]:
        """Index of the first calibration after each repair that has calibrations on both sides."""
        days = [event.date for event in self.events if event.kind == "repaired"]
        dates = [entry.date for entry in self.entries]
        firsts = {next((i for i, date in enumerate(dates) if date >= day), 0) for day in days}
        return sorted(firsts - {0})

    def _untold(self, known: Sequence[Break]) -> Break | None:
        """The most significant step without an event, if its probability is below the limit; else None."""
        group = self._groups(known)
        gaps = [i for i in range(1, len(self.entries)) if group[i] == group[i - 1]]
        suspects = [i for i in gaps if abs(self.agreement(i).correlated or 0.0) > 1.0]
        found = {i: self._step_probability(known, i) for i in suspects}
        best = min(found, key=lambda i: found[i], default=0)
        if best and found[best] < STEP_UNTOLD / (len(self.entries) - 1):
            return Break(best, "the value stepped, and no event explains it")
        return None

    def _step_probability(self, known: Sequence[Break], index: int) -> float:
        """Probability of a step as large as found if the sensor has not changed."""
        group = self._groups(known)
        drift = Drift(self.years, self.value, self.covariance, group)
        if group[index] != group[index - 1]:
            return 1.0
        below = drift.step(index).below(0.0)
        return 2 * min(below, 1 - below)

    def _groups(self, breaks: Sequence[Break]) -> NDArray[np.int_]:
        starts = {item.index for item in breaks}
        return np.cumsum([i in starts for i in range(len(self.entries))])

    @cached_property
    def group(self) -> NDArray[np.int_]:
        """Number of the series of each calibration, from 0."""
        return self._groups(self.breaks)

    @cached_property
    def drift(self) -> Drift | None:
        """The drift; None if no series has two calibrations at different dates."""
        if len(self.entries) < 2:
            return None
        drift = Drift(self.years, self.value, self.covariance, self.group)
        return drift if drift.determined else None

    @property
    def without_drift(self) -> str:
        """The reason why no drift is known; empty if it is."""
        if self.drift is not None:
            return ""
        return (
            "one calibration alone shows no drift"
            if len(self.entries) < 2
            else "no series has two dates"
        )

    @property
    def recalled(self) -> str:
        """Since when the sensor is withdrawn, in words; empty if it was calibrated or repaired since."""
        told = [
            event
            for event in self.events
            if event.kind in ("recalled", "repaired") and event.calibration_id is None
        ]
        withdrawn = told and told[-1].kind == "recalled" and told[-1].date >= self.entries[-1].date
        return f"recalled on {told[-1].date}" if withdrawn else ""

    def agreement(self, index: int) -> Agreement:
        """E_n of calibration ``index`` and the one before it."""
        return agreement(self.entries[index], self.entries[index - 1])


def life(entries: Sequence[Entry], events: Sequence[Event]) -> Life:
    """A life from all entries and events of a sensor, in any order."""
    kept = []
    left_out = []
    ordered = sorted(entries, key=lambda entry: (entry.date, entry.id))
    files = [(entry, frozenset(json.loads(entry.data_files))) for entry in ordered]
    present = next(
        (entry for entry in reversed(ordered) if _standing_in_the_way(entry) == ""), None
    )
    for entry in ordered:
        reason = (
            _standing_in_the_way(entry)
            or _another_quantity(entry, present)
            or _another_of_its_data(entry, files)
        )
        if reason:
            left_out.append((entry, reason))
        else:
            kept.append(_with_room(entry))
    ordered_events = sorted(events, key=lambda event: (event.date, event.id))
    return Life(tuple(kept), tuple(left_out), tuple(ordered_events))


def _standing_in_the_way(entry: Entry) -> str:
    if entry.standing in ("recalled", "superseded"):
        return entry.standing
    if entry.value is None or not math.isfinite(entry.value):
        return "no such value"
    if entry.u is None or not entry.u > 0:
        return "no uncertainty"
    return ""


def _another_quantity(entry: Entry, present: Entry | None) -> str:
    if present is None or entry.unit != present.unit:
        return f"in {entry.unit}"
    if entry.frequency_hz is None or present.frequency_hz is None:
        return ""
    same = abs(entry.frequency_hz / present.frequency_hz - 1.0) < 1e-6
    return "" if same else f"at {entry.frequency_hz:.6g} Hz"


def _another_of_its_data(entry: Entry, files: Sequence[tuple[Entry, frozenset[str]]]) -> str:
    """Of several evaluations of one measurement, keep one: the approved one, else the newest."""
    own = next(found for one, found in files if one is entry)
    for other, found in files:
        if other is not entry and own & found and not _standing_in_the_way(other):
            first, second = ((e.standing == "approved", e.id) for e in (entry, other))
            if second > first:
                return f"the same data as calibration {other.id}"
    return ""


def _with_room(entry: Entry) -> Entry:
    """Limit the shared part to the whole uncertainty."""
    square = sum(u**2 for u in entry.shared.values())
    whole = _MOST_SHARED * float(entry.u or 0.0) ** 2
    if square <= whole:
        return entry
    factor = math.sqrt(whole / square)
    return entry._replace(shared={key: factor * u for key, u in entry.shared.items()})


def covariance(one: Entry, other: Entry) -> float:
    """Covariance of the errors of two calibrations."""
    return (
        float(one.u or 0.0) ** 2
        if one.id == other.id
        else shared_covariance(one.shared, other.shared)
    )


def agreement(one: Entry, other: Entry) -> Agreement:
    """E_n of two calibrations, with and without the shared part of their errors (U, k = 2)."""
    u_one = float(one.u or 0.0)
    u_other = float(other.u or 0.0)
    both = covariance(one, other)
    identified = shared_covariance(stated_sources(one.shared), other.shared)
    arguments = (
        float(one.value or 0.0),
        COVERAGE_FACTOR * u_one,
        float(other.value or 0.0),
        COVERAGE_FACTOR * u_other,
    )
    return Agreement(
        normalized_error(*arguments),
        normalized_error(*arguments, both),
        normalized_error(*arguments, identified),
        assumed_sources(one.shared, other.shared),
        both / (u_one * u_other) if u_one * u_other > 0 else 0.0,
    )


def years_between(first: datetime.date, last: datetime.date) -> float:
    """Years of 365.25 days."""
    return (last - first).days / DAYS_A_YEAR

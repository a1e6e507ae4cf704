"""Life of a sensor in one quantity: its valid calibrations, their shared errors, and its series."""

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
from vibrident.lab.history.drift import SensorDrift
from vibrident.use.comparison import (
    COVERAGE_FACTOR,
    assumed_sources,
    normalized_error,
    shared_covariance,
    stated_sources,
)

DAYS_A_YEAR = 365.25
MAX_REPAIR_STEP_PROBABILITY = 0.05  # of a step at a repair that begins a new series
#: Probability that a jump is reported, over all calibrations of a sensor without a jump.
MAX_STEP_PROBABILITY = 1e-3
#: Largest shared part of a value's variance: rounding must not make the remainder negative.
_MAX_SHARED_PART = 1.0 - 1e-9


class Entry(NamedTuple):
    """Quantity of a calibration; a tuple, because a store gives ten thousand at a time."""

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
        """Return the standard uncertainty without the sources that calibrations may share."""
        if self.u is None:
            return None
        return math.sqrt(max(self.u**2 - sum(u**2 for u in self.shared.values()), 0.0))


@dataclass(frozen=True)
class Event:
    """Event of a sensor, or of one of its calibrations."""

    id: int
    kind: str
    date: datetime.date
    calibration_id: int | None = None
    by: str = ""
    note: str = ""
    recorded: str = ""


@dataclass(frozen=True)
class NormalisedError:
    """E_n of a calibration and the one before it."""

    ordinary: float | None  # as if both were independent; None if there is no uncertainty
    correlated: float | None  # without the shared sources in the uncertainty of their difference
    # the same, but for sources that no instrument identifies: these are taken as new each time
    identified: float | None
    assumed: tuple[str, ...]  # the words of those sources
    correlation: float  # of the two values


@dataclass(frozen=True)
class Break:
    """Beginning of a new series: the index of its first calibration, and the reason in words."""

    index: int
    why: str


@dataclass(frozen=True, eq=False)
class Life:
    """Valid calibrations of a sensor, in the order of their dates, and those left out."""

    entries: tuple[Entry, ...]  # with value and uncertainty, in one unit, no two of the same data
    left_out: tuple[tuple[Entry, str], ...]  # entry and reason, in words
    events: tuple[Event, ...]  # in the order of their dates

    @cached_property
    def years(self) -> FloatArray:
        """Return the time of each calibration from the first, in years of 365.25 days."""
        return np.array([years_between(self.entries[0].date, entry.date) for entry in self.entries])

    @cached_property
    def value(self) -> FloatArray:
        """Return the values, shape (n,)."""
        return np.array([entry.value for entry in self.entries], dtype=float)

    @cached_property
    def covariance(self) -> FloatArray:
        """Return the covariance of the errors of the calibrations, shape (n, n)."""
        return np.array([[covariance(a, b) for b in self.entries] for a in self.entries])

    @cached_property
    def identified_covariance(self) -> FloatArray:
        """Return the covariance with shared sources of identified instruments alone.

        Its shape is (n, n).
        """
        few = [entry._replace(shared=stated_sources(entry.shared)) for entry in self.entries]
        return np.array([[covariance(a, b) for b in few] for a in few])

    @cached_property
    def assumed(self) -> tuple[str, ...]:
        """Return the words of the sources that neighbours in time share by assumption."""
        pairs = itertools.pairwise(self.entries)
        words = (assumed_sources(earlier.shared, later.shared) for earlier, later in pairs)
        return tuple(dict.fromkeys(itertools.chain.from_iterable(words)))

    @cached_property
    def breaks(self) -> tuple[Break, ...]:
        """Return the beginning of each series but the first."""
        breaks: list[Break] = []
        for index in self._repaired():
            if self._step_probability(breaks, index) < MAX_REPAIR_STEP_PROBABILITY:
                breaks.append(Break(index, "repaired, and the value stepped"))
        while (step := self._unexplained_step(breaks)) is not None:
            breaks.append(step)
        return tuple(sorted(breaks, key=lambda item: item.index))

    def _repaired(self) -> list[int]:
        """Return the first calibration after each repair that has calibrations on both sides."""
        days = [event.date for event in self.events if event.kind == "repaired"]
        dates = [entry.date for entry in self.entries]
        firsts = {next((i for i, date in enumerate(dates) if date >= day), 0) for day in days}
        return sorted(firsts - {0})

    def _unexplained_step(self, explained: Sequence[Break]) -> Break | None:
        """Return the most significant step without an event, or None.

        Its probability must be below the limit.
        """
        group = self._groups(explained)
        gaps = [i for i in range(1, len(self.entries)) if group[i] == group[i - 1]]
        suspects = [i for i in gaps if abs(self.agreement(i).correlated or 0.0) > 1.0]
        probabilities = {i: self._step_probability(explained, i) for i in suspects}
        best = min(probabilities, key=lambda i: probabilities[i], default=0)
        if best and probabilities[best] < MAX_STEP_PROBABILITY / (len(self.entries) - 1):
            return Break(best, "the value stepped, and no event explains it")
        return None

    def _step_probability(self, explained: Sequence[Break], index: int) -> float:
        """Return the probability of a step as large if the sensor has not changed."""
        group = self._groups(explained)
        drift = SensorDrift(self.years, self.value, self.covariance, group)
        if group[index] != group[index - 1]:
            return 1.0
        below = drift.step(index).below(0.0)
        return 2 * min(below, 1 - below)

    def _groups(self, breaks: Sequence[Break]) -> NDArray[np.int_]:
        starts = {item.index for item in breaks}
        return np.cumsum([i in starts for i in range(len(self.entries))])

    @cached_property
    def group(self) -> NDArray[np.int_]:
        """Return the number of the series of each calibration, from 0."""
        return self._groups(self.breaks)

    @cached_property
    def drift(self) -> SensorDrift | None:
        """Return the drift; None if no series has two calibrations at different dates."""
        if len(self.entries) < 2:
            return None
        drift = SensorDrift(self.years, self.value, self.covariance, self.group)
        return drift if drift.determined else None

    @property
    def without_drift(self) -> str:
        """Return the reason why no drift is known; empty if it is."""
        if self.drift is not None:
            return ""
        return (
            "one calibration alone shows no drift"
            if len(self.entries) < 2
            else "no series has two dates"
        )

    @property
    def recalled(self) -> str:
        """Return the date of the sensor's recall in words.

        It is empty if the sensor was calibrated or repaired since.
        """
        changes = [
            event
            for event in self.events
            if event.kind in ("recalled", "repaired") and event.calibration_id is None
        ]
        withdrawn = (
            changes and changes[-1].kind == "recalled" and changes[-1].date >= self.entries[-1].date
        )
        return f"recalled on {changes[-1].date}" if withdrawn else ""

    def agreement(self, index: int) -> NormalisedError:
        """Return E_n of calibration ``index`` and the one before it."""
        return agreement(self.entries[index], self.entries[index - 1])


def life(entries: Sequence[Entry], events: Sequence[Event]) -> Life:
    """Return a life from all entries and events of a sensor, in any order."""
    valid = []
    left_out = []
    ordered = sorted(entries, key=lambda entry: (entry.date, entry.id))
    files = [(entry, frozenset(json.loads(entry.data_files))) for entry in ordered]
    present = next((entry for entry in reversed(ordered) if exclude_reason(entry) == ""), None)
    for entry in ordered:
        reason = (
            exclude_reason(entry)
            or other_quantity_reason(entry, present)
            or same_data_reason(entry, files)
        )
        if reason:
            left_out.append((entry, reason))
        else:
            valid.append(_with_limited_sharing(entry))
    ordered_events = sorted(events, key=lambda event: (event.date, event.id))
    return Life(tuple(valid), tuple(left_out), tuple(ordered_events))


def exclude_reason(entry: Entry) -> str:
    """Return the reason why an entry does not count by itself; empty if it counts."""
    if entry.standing in ("recalled", "superseded"):
        return entry.standing
    if entry.value is None or not math.isfinite(entry.value):
        return "no such value"
    if entry.u is None or not entry.u > 0:
        return "no uncertainty"
    return ""


def other_quantity_reason(entry: Entry, present: Entry | None) -> str:
    """Return the reason why an entry is of another quantity than the present one."""
    if present is None or entry.unit != present.unit:
        return f"in {entry.unit}"
    if entry.frequency_hz is None or present.frequency_hz is None:
        return ""
    same = abs(entry.frequency_hz / present.frequency_hz - 1.0) < 1e-6
    return "" if same else f"at {entry.frequency_hz:.6g} Hz"


def same_data_reason(entry: Entry, files: Sequence[tuple[Entry, frozenset[str]]]) -> str:
    """Return the reason why another evaluation of the same measurement counts instead.

    Of several evaluations the approved one counts, else the newest.
    """
    of_entry = next(hashes for each, hashes in files if each is entry)
    for rival, hashes in files:
        if rival is not entry and of_entry & hashes and not exclude_reason(rival):
            first, second = ((e.standing == "approved", e.id) for e in (entry, rival))
            if second > first:
                return f"the same data as calibration {rival.id}"
    return ""


def _with_limited_sharing(entry: Entry) -> Entry:
    """Limit the shared part to the total uncertainty."""
    square = sum(u**2 for u in entry.shared.values())
    limit = _MAX_SHARED_PART * float(entry.u or 0.0) ** 2
    if square <= limit:
        return entry
    factor = math.sqrt(limit / square)
    return entry._replace(shared={key: factor * u for key, u in entry.shared.items()})


def covariance(a: Entry, b: Entry) -> float:
    """Return the covariance of the errors of two calibrations."""
    return float(a.u or 0.0) ** 2 if a.id == b.id else shared_covariance(a.shared, b.shared)


def agreement(entry: Entry, before: Entry) -> NormalisedError:
    """Return E_n of two calibrations, with and without shared errors (U, k = 2)."""
    u = float(entry.u or 0.0)
    u_before = float(before.u or 0.0)
    both = covariance(entry, before)
    identified = shared_covariance(stated_sources(entry.shared), before.shared)
    arguments = (
        float(entry.value or 0.0),
        COVERAGE_FACTOR * u,
        float(before.value or 0.0),
        COVERAGE_FACTOR * u_before,
    )
    return NormalisedError(
        normalized_error(*arguments),
        normalized_error(*arguments, both),
        normalized_error(*arguments, identified),
        assumed_sources(entry.shared, before.shared),
        both / (u * u_before) if u * u_before > 0 else 0.0,
    )


def years_between(first: datetime.date, last: datetime.date) -> float:
    """Return the years of 365.25 days between two dates."""
    return (last - first).days / DAYS_A_YEAR

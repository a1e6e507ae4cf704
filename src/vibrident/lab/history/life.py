"""Describe a sensor over the years in one quantity: valid calibrations, shared errors, series."""

from __future__ import annotations

import bisect
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

from vibrident.base.fields import NamedNumbers
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
    value: float | None  # None if the result has no such value
    u: float | None  # standard uncertainty of the value; None if not stated
    unit: str  # of value and u
    frequency_hz: float | None = None  # if the quantity is a sensitivity at a frequency
    # source that other calibrations may share → its standard uncertainty, same unit
    shared: NamedNumbers = MappingProxyType({})
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

    @property
    def changes_sensor(self) -> bool:
        """Return whether it recalls or repairs the sensor itself, not one of its calibrations."""
        return self.kind in ("recalled", "repaired") and self.calibration_id is None


@dataclass(frozen=True)
class NormalisedError:
    """E_n of a calibration and the one before it."""

    ordinary: float | None  # as if both were independent; None if there is no uncertainty
    correlated: float | None  # shared sources cancel in the difference
    identified: float | None  # only sources of identified instruments cancel
    assumed: tuple[str, ...]  # shared sources that no instrument identifies
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
        """Return the covariance by shared sources of identified instruments only, shape (n, n)."""
        entries = [entry._replace(shared=stated_sources(entry.shared)) for entry in self.entries]
        return np.array([[covariance(a, b) for b in entries] for a in entries])

    @cached_property
    def assumed(self) -> tuple[str, ...]:
        """Return the sources that successive calibrations share by assumption, in words."""
        pairs = itertools.pairwise(self.entries)
        sources = (assumed_sources(earlier.shared, later.shared) for earlier, later in pairs)
        return tuple(dict.fromkeys(itertools.chain.from_iterable(sources)))

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
        dates = [entry.date for entry in self.entries]
        repairs = [event.date for event in self.events if event.kind == "repaired"]
        firsts = {bisect.bisect_left(dates, repair) for repair in repairs}
        return sorted(firsts - {0, len(dates)})

    def _unexplained_step(self, explained: Sequence[Break]) -> Break | None:
        """Return the most significant step without an event, or None.

        Its probability must be below the limit.
        """
        group = self._groups(explained)
        gaps = [i for i in range(1, len(self.entries)) if group[i] == group[i - 1]]
        suspects = [i for i in gaps if abs(self.agreement(i).correlated or 0.0) > 1.0]
        probabilities = {i: self._step_probability(explained, i) for i in suspects}
        if not probabilities:
            return None
        index = min(probabilities, key=lambda i: probabilities[i])
        if probabilities[index] < MAX_STEP_PROBABILITY / (len(self.entries) - 1):
            return Break(index, "the value stepped, and no event explains it")
        return None

    def _step_probability(self, explained: Sequence[Break], index: int) -> float:
        """Return the probability of a step as large if the sensor has not changed."""
        group = self._groups(explained)
        if group[index] != group[index - 1]:
            return 1.0
        step = SensorDrift(self.years, self.value, self.covariance, group).step(index)
        chance_negative = step.below(0.0)
        return 2 * min(chance_negative, 1 - chance_negative)

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
        last = next((e for e in reversed(self.events) if e.changes_sensor), None)
        if last is None or last.kind == "repaired" or last.date < self.entries[-1].date:
            return ""
        return f"recalled on {last.date}"

    def agreement(self, index: int) -> NormalisedError:
        """Return E_n of calibration ``index`` and the one before it."""
        return agreement(self.entries[index], self.entries[index - 1])


def life(entries: Sequence[Entry], events: Sequence[Event]) -> Life:
    """Return a life from all entries and events of a sensor, in any order."""
    valid = []
    left_out = []
    ordered = sorted(entries, key=lambda entry: (entry.date, entry.id))
    files = {entry.id: frozenset(json.loads(entry.data_files)) for entry in ordered}
    latest = next((entry for entry in reversed(ordered) if exclude_reason(entry) == ""), None)
    for entry in ordered:
        reason = (
            exclude_reason(entry)
            or other_quantity_reason(entry, latest)
            or same_data_reason(entry, ordered, files)
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


def other_quantity_reason(entry: Entry, latest: Entry | None) -> str:
    """Return the reason why an entry is of another quantity than the latest; empty if it is not."""
    if latest is None or entry.unit != latest.unit:
        return f"in {entry.unit}"
    if entry.frequency_hz is None or latest.frequency_hz is None:
        return ""
    is_same = abs(entry.frequency_hz / latest.frequency_hz - 1.0) < 1e-6
    return "" if is_same else f"at {entry.frequency_hz:.6g} Hz"


def same_data_reason(
    entry: Entry, entries: Sequence[Entry], files: Mapping[int, frozenset[str]]
) -> str:
    """Return the reason why another evaluation of the same measurement counts instead.

    Of several evaluations the approved one counts, else the newest.

    Args:
        entry: the evaluation.
        entries: all evaluations of the sensor.
        files: number of an entry → hashes of its data files.
    """
    for rival in entries:
        if rival is entry or not files[entry.id] & files[rival.id] or exclude_reason(rival):
            continue
        if (rival.standing == "approved", rival.id) > (entry.standing == "approved", entry.id):
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
    shared = covariance(entry, before)
    identified = shared_covariance(stated_sources(entry.shared), before.shared)
    values = (
        float(entry.value or 0.0),
        COVERAGE_FACTOR * u,
        float(before.value or 0.0),
        COVERAGE_FACTOR * u_before,
    )
    return NormalisedError(
        ordinary=normalized_error(*values),
        correlated=normalized_error(*values, shared),
        identified=normalized_error(*values, identified),
        assumed=assumed_sources(entry.shared, before.shared),
        correlation=shared / (u * u_before) if u * u_before > 0 else 0.0,
    )


def years_between(first: datetime.date, last: datetime.date) -> float:
    """Return the years of 365.25 days between two dates."""
    return (last - first).days / DAYS_A_YEAR

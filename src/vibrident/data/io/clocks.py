"""Find the clock of each channel of a record, by time stamps or a header of its file.

The rate of the calibration file must agree with what the files state, each within its own rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from decimal import Decimal

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.columns import Clock, ColumnFile, Positions, StartTime
from vibrident.data.io.header_units import SourceColumn, is_time
from vibrident.data.io.sampling import SAME_RATE, agreed_clock
from vibrident.data.io.timeline import Timeline, timeline_from, timeline_of
from vibrident.data.records import FloatArray

_MIN_STAMPS = 8  # fewer are no statement about a rate
_MAX_BACKWARDS = 0.25  # of the steps between times; more is no clock that is set back
_SAME_START = 1e-3  # of an interval, within which two columns of times begin together
#: Relative; values that rise this close to a known rate, in some unit, are times.
_LIKE_RATE = 0.01
#: Seconds in a unit that a column of times without one may be in, beside a stated rate.
_POSSIBLE_SECONDS = (1.0, 1e-3, 1e-6, 1e-9, 1e3, 60.0, 3600.0, 86400.0, 1 / 60, 1 / 3600)


@dataclass(frozen=True, eq=False)
class ChannelClock:
    """The clock of a channel, and the time stamps that it is from, if any."""

    clock: Clock
    timeline: Timeline | None = None
    note: str = ""
    has_unread_times: bool = False  # a column of times that are text, missing or go back

    def begun_at(self, start: StartTime | None) -> ChannelClock:
        """Return the rate alone from a start that a channel's file states; None: the clock."""
        return self if start is None else ChannelClock(replace(self.clock, start=start))

    @property
    def is_even(self) -> bool:
        """Return whether every row is a sample of an even raster."""
        line = self.timeline
        return line is None or not (line.is_uneven or line.doubled or line.lost)

    @property
    def begins_s(self) -> float:
        """Return the time of the first sample by its stamp, s; 0 without stamps."""
        if self.timeline is None or self.clock.start is None:
            return 0.0
        return self.clock.start.ns * 1e-9


@dataclass(eq=False)
class ClockReader:
    """Reader of the clocks of a record's channels.

    Attributes:
        stated_hz: rate of the calibration file, or None.
        time_column: column of times that the calibration file names, or None.
        where: entry of the calibration file, for messages.
        main: the record's file, whose column ``time_column`` is.
    """

    stated_hz: float | None
    time_column: int | str | None
    where: str
    main: ColumnFile
    _timelines: dict[tuple[int, int], Timeline | None] = field(default_factory=dict)
    _rising: dict[tuple[int, int], bool] = field(default_factory=dict)
    _unread: set[int] = field(default_factory=set)  # files with times that cannot be used
    _main_hz: float | None = None  # of the first channel of the record's file

    def clock_of(
        self, source: ColumnFile, position: int, channels: Positions
    ) -> ChannelClock | None:
        """Return the clock of a channel; None if nothing states one.

        Args:
            source: the channel's file.
            position: its column.
            channels: columns of the file that are channels, none of which is a time column.

        Raises:
            InputError: two statements contradict each other, or time stamps cannot be used.
        """
        column, is_asked_for = self._time_column_of(source, position, channels)
        clock = source.clock(position)
        if column is not None:
            needed = is_asked_for or (self.stated_hz is None and clock is None)
            timeline = self._timeline(SourceColumn(source, column, "time_column"), needed=needed)
            if timeline is not None and len(channels) > 1:
                self._require_one_clock(source, column, timeline, {*channels})
        else:
            timeline = _timeline_of_stamps(source, position)
        declared = None
        if self.stated_hz is not None:
            declared = replace(stated_clock(self.stated_hz), start=source.start(position))
        if declared is not None and source is not self.main:
            if clock is None and timeline is None:
                return ChannelClock(declared, has_unread_times=id(source) in self._unread)
            declared = None  # the rate of the record's file; another file states its own
        by_stamps = None if timeline is None else timeline.clock
        agreed = agreed_clock(
            [
                ("the calibration file", declared),
                (source.file, clock),
                (self._name(source, column), by_stamps),
            ],
            f"{self.where}, for {source.file}",
        )
        if agreed is None:
            return None
        self._main_hz = self._main_hz or agreed.rate_hz
        if (
            timeline is not None
            and timeline.is_uneven
            and not is_asked_for
            and declared is not None
        ):
            raise self._uneven_beside_rate(source, column)
        notes = [timeline.note if timeline is not None else "", _rounding_note(agreed, declared)]
        is_unread = timeline is None and id(source) in self._unread
        return ChannelClock(agreed, timeline, "; ".join(filter(None, notes)), is_unread)

    def has_time_column(self, source: ColumnFile, position: int, channels: Positions) -> bool:
        """Return whether a column of the file gives the times of a channel; as ``clock_of``."""
        return self._time_column_of(source, position, channels)[0] is not None

    def _name(self, source: ColumnFile, column: int | None) -> str:
        return source.file if column is None else f"{source.file}, column {source.names[column]!r}"

    def _time_column_of(
        self, source: ColumnFile, position: int, channels: Positions
    ) -> tuple[int | None, bool]:
        """Return the time column of a channel, and whether the calibration file names one."""
        requested = self._requested_column(source, channels)
        candidates = [
            column
            for column in range(len(source.names))
            if column not in channels and self._holds_times(source, column, position)
        ]
        if requested is not None and requested not in candidates:
            candidates = sorted([*candidates, requested])
        if not candidates:
            return None, False
        # time columns side by side are one clock
        firsts = [column for column in candidates if column - 1 not in candidates]
        first = max((column for column in firsts if column < position), default=firsts[0])
        if requested is not None:
            first_of_requested = max(column for column in firsts if column <= requested)
            if first_of_requested == first or len(firsts) == 1:
                return requested, True
        return first, requested is not None

    def _holds_times(self, source: ColumnFile, column: int, position: int) -> bool:
        """Tell whether a column holds times by its name or type; by its values beside no clock."""
        return (
            is_time(SourceColumn(source, column).header)
            or source.in_seconds(column)
            or (source.clock(position) is None and self._rises_at_rate(source, column))
        )

    def _rises_at_rate(self, source: ColumnFile, column: int) -> bool:
        """Tell whether a column holds times by its values, at the known rate, whatever its name."""
        key = (id(source), column)
        rate_hz = self._known_rate()
        if key not in self._rising and rate_hz is not None and source.may_rise(column):
            try:
                seconds = SourceColumn(source, column).seconds
                (values,) = source.load([column])
            except InputError:  # text, or a column in another unit than of time
                self._rising[key] = False
            else:
                unit_s = _unit_beside_rate(values, rate_hz)
                self._rising[key] = unit_s is not None and seconds in (None, unit_s)
        return self._rising.get(key, False)

    def _known_rate(self) -> float | None:
        """Return the rate of the calibration file, else of the record's file, if known by now."""
        if self.stated_hz is not None or self.time_column is None:
            return self.stated_hz or self._main_hz
        column = self.main.position_of(self.time_column, "[sampling] time_column")
        timeline = self._timeline(SourceColumn(self.main, column, "time_column"), needed=True)
        return None if timeline is None else timeline.clock.rate_hz

    def _requested_column(self, source: ColumnFile, channels: Positions) -> int | None:
        """Return the column that the calibration file names, in this file; None for none."""
        if self.time_column is None:
            return None
        if source is self.main:
            return source.position_of(self.time_column, "[sampling] time_column")
        if isinstance(self.time_column, str):
            names = source.names
            return names.index(self.time_column) if self.time_column in names else None
        position = self.time_column - 1
        if position >= len(source.names) or position in channels:
            return None
        return position if is_time(SourceColumn(source, position).header) else None

    def _timeline(self, column: SourceColumn, *, needed: bool) -> Timeline | None:
        key = (id(column.source), column.position)
        if key not in self._timelines:
            self._timelines[key] = self._read_timeline(column, needed=needed)
        return self._timelines[key]

    def _read_timeline(self, column: SourceColumn, *, needed: bool) -> Timeline | None:
        """Read a column of times; None if it states nothing about a rate that is known."""
        try:
            (times,) = column.source.load([column.position])
            rate_hz = self.stated_hz or self._main_hz
            unit_s = None
            if rate_hz is not None and column.seconds is None:
                unit_s = _unit_beside_rate(times, rate_hz)
                if unit_s is None and not needed and np.all(np.diff(times) == 1.0):
                    return None
            if not needed and times.size < _MIN_STAMPS:
                return None
            backwards = np.count_nonzero(np.diff(times) < 0.0)
            is_sorted = backwards <= _MAX_BACKWARDS * times.size
            timeline = timeline_of(column, times, unit_s, self.stated_hz) if is_sorted else None
        except InputError:  # text, missing ones, or times that go back: no clock
            if needed:
                raise
            self._unread.add(id(column.source))
            return None
        if timeline is None:
            raise _rows_out_of_order(column)
        return timeline

    def _require_one_clock(
        self, source: ColumnFile, column: int, timeline: Timeline, channels: set[int]
    ) -> None:
        """Refuse times side by side of two channels whose starts differ: whose is which?"""
        start = timeline.clock.start
        for neighbour in {column - 1, column + 1} & {*range(len(source.names))} - channels:
            if not self._holds_times(source, neighbour, min(channels)):
                continue
            times = self._timeline(SourceColumn(source, neighbour, "time_column"), needed=False)
            other_start = None if times is None else times.clock.start
            if start is None or other_start is None or start.epoch or other_start.epoch:
                continue
            apart_s = (other_start.ns - start.ns) * 1e-9
            if abs(apart_s) > max(_SAME_START / timeline.clock.rate_hz, timeline.rounding_s):
                raise InputError(
                    "Two time columns side by side state different starts.",
                    expected="one clock, or each channel's times directly before the channel",
                    found=f"{source.names[neighbour]!r}, {apart_s:+.9g} s from "
                    f"{source.names[column]!r}",
                    where=source.file,
                    remedy="remove the column that does not count, or move each before its channel",
                )

    def _uneven_beside_rate(self, source: ColumnFile, column: int | None) -> InputError:
        return InputError(
            "The samples were not taken at an even rate.",
            expected=f"even times, for rate_hz = {self.stated_hz!r}",
            found="times that deviate from an even raster by more than their rounding",
            where=self._name(source, column),
            remedy="give time_column instead of rate_hz: the samples are evened by their times",
        )


def _rows_out_of_order(column: SourceColumn) -> InputError:
    return InputError(
        "The rows are not in the order of their times.",
        expected="times that increase from row to row",
        found="many that decrease",
        where=f"{column.source.file}, column {column.header!r}",
        remedy="sort the rows by their times, or remove the times if they are wrong",
    )


def _unit_beside_rate(times: FloatArray, rate_hz: float) -> float | None:
    """Return the seconds in the unit in which times go on at a rate; None if in no usual one.

    The steps of a counter are 1.
    """
    steps = np.diff(times)
    if steps.size < _MIN_STAMPS - 1 or not np.all(np.isfinite(times)) or np.all(steps == 1.0):
        return None
    usual = (float(np.median(steps)), float(np.mean(steps)))  # rounded ones, and with gaps
    if not np.all(steps >= 0.0) or min(usual) <= 0.0:
        return None
    return next(
        (
            seconds
            for seconds in _POSSIBLE_SECONDS
            if any(abs(step * seconds * rate_hz - 1.0) <= _LIKE_RATE for step in usual)
        ),
        None,
    )


def file_clock(source: ColumnFile, position: int) -> Clock | None:
    """Return the clock that a file states of a channel, by a header, time stamps or both."""
    timeline = _timeline_of_stamps(source, position)
    by_stamps = None if timeline is None else timeline.clock
    statements = [("the header", source.clock(position)), ("the time stamps", by_stamps)]
    return agreed_clock(statements, source.file)


def _timeline_of_stamps(source: ColumnFile, position: int) -> Timeline | None:
    """Return the timeline of stamps that a format gives each sample of a channel; None if none."""
    stamps = source.stamps(position)
    if stamps is None or stamps.size < 2:
        return None
    start = source.start(position) or StartTime.on_own_clock(float(stamps[0]))

    def locate(row: int) -> str:
        return f"time stamp of {source.locate(position, row)}"

    return timeline_from(stamps, start, locate)


def stated_clock(rate_hz: float) -> Clock:
    """Return the clock of a rate as typed, whose rounding is half a unit of its last decimal."""
    exponent = Decimal(repr(rate_hz)).as_tuple().exponent
    assert isinstance(exponent, int)  # finite
    return Clock(rate_hz, max(0.5 * 10.0**exponent / rate_hz, SAME_RATE))


def _rounding_note(agreed: Clock, declared: Clock | None) -> str:
    if declared is not None or agreed.rate_rounding <= SAME_RATE:
        return ""
    rounding = f"{agreed.rate_rounding:.1g} (relative)"
    return f"sampling rate: {agreed.rate_hz!r} Hz, which the file states to {rounding}"


def is_same_rate(first: Clock, second: Clock) -> bool:
    """Tell whether two rates agree within their rounding."""
    allowed = first.rate_rounding + second.rate_rounding
    return math.isclose(first.rate_hz, second.rate_hz, rel_tol=max(allowed, SAME_RATE))


def require_even(clock: ChannelClock, source: ColumnFile, where: str) -> None:
    """Refuse uneven, doubled or lost samples, which demodulation of raw light does not allow."""
    timeline = clock.timeline
    if timeline is not None and not clock.is_even:
        raise InputError(
            "The samples beside an interferometer's signals are not even.",
            expected="even times, none of them missing or twice",
            found=f"{timeline.lost} missing, {timeline.doubled} twice"
            + (", uneven" if timeline.is_uneven else ""),
            where=f"{where}, for {source.file}",
            remedy="export the record at an even rate, or give rate_hz if only the times are wrong",
        )

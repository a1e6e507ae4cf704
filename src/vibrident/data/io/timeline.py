"""Read time stamps of a column: their unit, rounding, and the even raster that they lie near.

A column of times is a statement about every sample. It is checked for a plausible unit, its doubled
and lost samples are found, and what deviates from an even raster by more than the rounding of the
stamps is uneven sampling.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.columns import Clock, IntArray, Locate, StartTime
from vibrident.data.io.header_units import SourceColumn
from vibrident.data.io.sampling import SAME_RATE
from vibrident.data.records import FloatArray

#: A stamp further from its place than this, in intervals, belongs to another place.
MAX_JITTER = 0.5
#: Rounded times span a width about their true places, and turn the regression by at most three
#: halves of it over the record.
_MAX_SPAN = 2.5
#: Of times without a unit, s: a longer one is of another unit, or a counter.
MAX_INTERVAL_S = 1.0
#: Seconds since 1970 of the years 2000 to 2100; in s, ms, µs and ns the spans do not overlap.
_EPOCH_S = (946_684_800.0, 4_102_444_800.0)
_EPOCH_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_LAST_TIMES = 32  # whose last digits are all zero by chance in 1 of 10³² files
#: Days since year 0 (MATLAB) and since 1900 (Excel) of the years 2000 to 2100.
_DAY_NUMBERS = ((730_486.0, 767_011.0), (36_526.0, 73_051.0))
_SHORTEST_STEP_S = 1e-6  # of times in s that begin at such a number
_MAX_LOST = 0.5  # part of the raster; with more, the raster itself is a guess
_FEWEST_EPOCH_STEPS_S = 3600.0  # an hour between samples is no record of vibration
_EXPECTED = "increasing times in seconds, at an even rate but for jitter below half an interval"
_REMEDY = "cut the file there, or give rate_hz if only the time stamps are wrong"


@dataclass(frozen=True, eq=False)
class Timeline:
    """Time stamps of the rows of a column.

    Attributes:
        clock: rate by regression over all stamps, its rounding, and the start.
        rows: shape (m,), rows that count; a row whose stamp repeats the one before does not.
        raster_index: shape (m,), of each on the even raster, from 0; lost samples leave holes.
        offsets: shape (m,), deviation of each from its place, in intervals; zero where the
            deviation is no more than the rounding of the stamps.
        rounding_s: width of the rounding of a stamp, s.
        note: what was understood, for the history; "" for plain seconds.
    """

    clock: Clock
    rows: IntArray
    raster_index: IntArray
    offsets: FloatArray
    rounding_s: float
    note: str = ""

    @property
    def is_uneven(self) -> bool:
        """Tell whether samples were taken at uneven times."""
        return bool(np.any(self.offsets))

    @property
    def doubled(self) -> int:
        """Return the number of rows that repeat a time."""
        return int(self.rows[-1]) + 1 - self.rows.size

    @property
    def lost(self) -> int:
        """Return the number of samples that are missing."""
        return int(self.raster_index[-1]) + 1 - self.raster_index.size


def timeline_of(
    column: SourceColumn,
    times: FloatArray,
    unit_s: float | None = None,
    stated_hz: float | None = None,
) -> Timeline:
    """Return the timeline of a column of times, in the unit of its header.

    Args:
        column: of a file.
        times: shape (rows,), as the file gives them.
        unit_s: seconds in a unit of the times where that is known; None: by the header.
        stated_hz: as of ``timeline_from``.

    Raises:
        InputError: a time is missing, the unit is not plausible, times go back, or no even raster
            is within half an interval of all of them.
    """
    source = column.source
    position = column.position
    source.require_finite(position, times, 0, "repair the time column, or give rate_hz")

    def locate(row: int) -> str:
        return source.locate(position, row)

    if times.size < 2:
        raise _uneven("A time column needs two rows or more.", f"{times.size} times", locate(0))
    seconds = column.seconds if unit_s is None else unit_s
    note = ""
    if seconds is None:
        seconds, note = _plausible_unit(times, column.header, locate)
    elif seconds != 1.0 and unit_s is None:
        name = source.names[position]
        note = f"time: column {position + 1} ({name!r}) × {seconds!r} → s, by the header"
    start = source.start(position)
    if start is None or not source.in_seconds(position):
        first_s = float(times[0]) * seconds
        start = StartTime(round(first_s * 1e9), epoch=_EPOCH_S[0] <= first_s < _EPOCH_S[1])
    return timeline_from(times, start, locate, seconds, note, stated_hz)


def timeline_from(
    times: FloatArray,
    start: StartTime,
    locate: Locate,
    seconds: float = 1.0,
    note: str = "",
    stated_hz: float | None = None,
) -> Timeline:
    """Return the timeline of times.

    Args:
        times: shape (rows,), finite.
        start: of the first row.
        locate: description of a row's place, for messages.
        seconds: in a unit of the times.
        note: passed on.
        stated_hz: rate that is stated beside the times. A time that repeats is no doubled sample
            where rounding repeats it at this rate.

    Raises:
        InputError: as :func:`timeline_of`.
    """
    elapsed_s = (times - times[0]) * seconds
    resolution_s = float(np.spacing(np.max(np.abs(times)))) * seconds
    steps = np.diff(elapsed_s)
    if (back := np.flatnonzero(steps < 0)).size:
        row = int(back[0]) + 1
        text = f"{elapsed_s[row] - elapsed_s[row - 1]:.9g} s from the row before"
        raise _uneven("The times do not increase.", text, locate(row))
    rows = np.concatenate([[0], np.flatnonzero(steps > 0) + 1])
    if rows.size < 2 or rows.size < (1.0 - _MAX_LOST) * elapsed_s.size:
        raise _repeated(elapsed_s, rows, resolution_s, locate)
    if _rounding_repeats(elapsed_s, rows, stated_hz, resolution_s):
        rows = np.arange(elapsed_s.size)
        times_s = elapsed_s
        raster_index = rows
        interval, origin = _regression(rows, elapsed_s)
    else:
        times_s = elapsed_s[rows]
        raster_index, interval, origin = _raster(times_s, lambda index: locate(int(rows[index])))
    deviation = times_s - origin - interval * raster_index
    rounding_s = _rounding(times_s, resolution_s)
    span = float(np.max(deviation) - np.min(deviation))
    is_even = span <= _MAX_SPAN * rounding_s + 4.0 * resolution_s
    offsets = np.zeros(times_s.size) if is_even else deviation / interval
    worst = float(np.max(np.abs(deviation - deviation.mean())))
    spread = max(3.0 * worst / interval / times_s.size, SAME_RATE) if is_even else SAME_RATE
    begin = StartTime(start.ns + round(origin * 1e9), start.epoch)
    clock = Clock(1.0 / interval, spread, begin)
    return Timeline(clock, rows, raster_index, offsets, max(rounding_s, resolution_s), note)


def _repeated(
    elapsed_s: FloatArray, rows: IntArray, resolution_s: float, locate: Locate
) -> InputError:
    """Return the error of times most of which are that of the row before.

    Arguments as of :func:`_rounding_repeats`.
    """
    last = elapsed_s.size - 1
    mean_hz = last / float(elapsed_s[-1]) if elapsed_s[-1] > 0 else None
    if not _rounding_repeats(elapsed_s, rows, mean_hz, resolution_s):
        return _uneven("The times do not increase.", "the same time in most rows", locate(1))
    return InputError(
        "The times are rounded, to the same one in most rows.",
        expected="a time of its own in each row, or rate_hz",
        found=f"{rows.size} different times in {elapsed_s.size} rows",
        where=locate(1),
        remedy=f"give rate_hz, by these times about {float(f'{mean_hz:.3g}'):g}",
    )


def _rounding_repeats(
    elapsed_s: FloatArray, rows: IntArray, rate_hz: float | None, resolution_s: float
) -> bool:
    """Tell whether times that repeat are those of an even clock of a rate, rounded.

    Args:
        elapsed_s: of all rows, shape (rows,).
        rows: whose time is not that of the row before.
        rate_hz: of the clock; None where it is not known.
        resolution_s: of a time as a number, s.
    """
    if rate_hz is None or rows.size == elapsed_s.size:
        return False
    deviation = elapsed_s - np.arange(elapsed_s.size) / rate_hz
    return bool(np.ptp(deviation) <= _MAX_SPAN * _rounding(elapsed_s[rows], resolution_s))


def _raster(times: FloatArray, locate: Locate) -> tuple[IntArray, float, float]:
    """Return place of each time on the even raster, its interval and its origin, by regression."""
    raster_index = np.arange(times.size)
    interval, origin = _regression(raster_index, times)
    if np.max(np.abs(times - origin - interval * raster_index)) <= MAX_JITTER * interval:
        return raster_index, interval, origin
    steps = np.diff(times)
    usual = float(np.median(steps))
    raster_index = np.concatenate([[0], np.cumsum(np.maximum(np.rint(steps / usual), 1.0))]).astype(
        np.int64
    )
    interval, origin = _regression(raster_index, times)
    deviation = np.abs(times - origin - interval * raster_index)
    if np.max(deviation) > MAX_JITTER * interval:
        at = int(np.argmax(deviation))
        text = f"a time {deviation[at] / interval:.3g} intervals away from even spacing"
        raise _uneven("The sampling rate drifts.", text, locate(at))
    if times.size < (1.0 - _MAX_LOST) * (raster_index[-1] + 1):
        at = int(np.argmax(steps))
        text = f"a step of {steps[at]:.9g} s where the others are {usual:.9g} s"
        raise _uneven("The record has a gap.", text, locate(at + 1))
    return raster_index, interval, origin


def _regression(raster_index: IntArray, times: FloatArray) -> tuple[float, float]:
    """Return interval and origin of the straight line through times over places."""
    centred = raster_index - raster_index.mean()
    interval = float(centred @ times / (centred @ centred))
    return interval, float(times.mean() - interval * raster_index.mean())


def _rounding(times: FloatArray, resolution_s: float) -> float:
    """Return the width of the rounding of times: decimal places, single precision, or ticks.

    Digits are those of the last times, as significant ones round these most.
    """
    last_times = times[-_LAST_TIMES:]
    largest = float(np.max(np.abs(last_times)))
    if np.all(last_times == last_times.astype(np.float32)):
        return float(np.spacing(np.float32(largest)))
    widths = [resolution_s]
    for exponent in range(0, -13, -1):
        width = 10.0**exponent
        multiples = last_times / width
        if np.all(np.abs(multiples - np.rint(multiples)) < 1e-3 + 4.0 * resolution_s / width):
            widths.append(width)
            break
    steps = np.diff(times[times.size // 2 - 1 :])
    low = float(np.min(steps))
    high = float(np.max(steps))
    exact = max(widths)
    near_either = np.minimum(np.abs(steps - low), np.abs(steps - high))
    if high > low and np.all(near_either <= exact + 4.0 * resolution_s):
        widths.append(high - low)  # an even clock read in ticks has steps of two lengths
    return max(widths)


def _plausible_unit(times: FloatArray, name: str, locate: Locate) -> tuple[float, str]:
    """Return the seconds in a unit of times that state none, and what was understood."""
    first = float(times[0])
    usual = float(np.median(np.diff(times)))
    for unit, seconds in _EPOCH_UNITS.items():
        is_of_epoch = _EPOCH_S[0] <= first * seconds < _EPOCH_S[1]
        if is_of_epoch and 0.0 < usual * seconds < _FEWEST_EPOCH_STEPS_S:
            day = datetime.datetime.fromtimestamp(first * seconds, datetime.UTC).date()
            note = f"time: {name!r} taken for {unit} since 1970 (first sample on {day})"
            return seconds, note
    are_days = usual < _SHORTEST_STEP_S and any(low <= first < high for low, high in _DAY_NUMBERS)
    if usual >= MAX_INTERVAL_S or are_days:
        is_counter = bool(np.all(np.diff(times) == 1.0))
        raise InputError(
            "The unit of the time column is not known.",
            expected="seconds, or a unit in the header, such as 'time (ms)'",
            found=f"{name!r} with steps of {usual:.9g}"
            + (", as of a counter" if is_counter else "")
            + (f" from {first:.9g}, as of days" if are_days else ""),
            where=locate(0),
            remedy="write the unit into the header, such as 'time (d)' for days, or give rate_hz",
        )
    return 1.0, ""


def _uneven(problem: str, value: str, where: str) -> InputError:
    return InputError(problem, expected=_EXPECTED, found=value, where=where, remedy=_REMEDY)

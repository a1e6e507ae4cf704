"""Times of day as text, with a date or without: ISO 8601, German and US dates, AM and PM, zones."""

from __future__ import annotations

import datetime
import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrident.base.errors import InputError
from vibrident.data.io.columns import IntArray, Locate
from vibrident.data.records import FloatArray

_DAY_NS = 86_400 * 10**9
_SECOND_NS = 10**9
_EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
_FRACTION_DIGITS = 9  # of a fraction that count: nanoseconds
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_FIRST_YEAR = 1678  # first whole year that 64-bit nanoseconds since 1970 can express
_LAST_YEAR = 2261  # last one
_STAMP = re.compile(
    r"(?:(?P<date>\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?\.\d\d?\.\d{4}|\d\d?/\d\d?/\d{4}"
    r"|\d\d?[- ][A-Za-z]{3}[- ]\d{4})(?:,? +|T))?"
    r"(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d)(?:[.,](?P<fraction>\d+))?"
    r"(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?(?: ?(?:Z|UTC|GMT|(?P<zone>[+-]\d\d(?::?\d\d)?)))?"
)


@dataclass(frozen=True)
class Stamps:
    """A column of times of day: nanoseconds since 1970, or since a midnight; shape (rows,)."""

    ns: IntArray
    is_missing: NDArray[np.bool_]  # shape (rows,)
    dated: bool

    @property
    def elapsed_s(self) -> FloatArray:
        """Return the seconds since the first row that has a time; NaN where there is none."""
        seconds = np.full(self.ns.shape, np.nan)
        present = self.ns[~self.is_missing]
        seconds[~self.is_missing] = (present - present[:1]) / _SECOND_NS  # keeps the digits
        return seconds


def is_stamp(cell: str) -> bool:
    """Tell whether a cell is a time of day, with or without a date."""
    return _STAMP.fullmatch(cell) is not None


def has_fraction(cell: str) -> bool:
    """Tell whether a time of day is written to fractions of a second."""
    match = _STAMP.fullmatch(cell)
    return match is not None and match["fraction"] is not None


def parse_stamps(cells: Sequence[str], missing: frozenset[str], locate: Locate) -> Stamps:
    """Parse a column of times of day; without dates, midnight is passed forwards.

    Args:
        cells: of the column, stripped.
        missing: texts that stand for no value.
        locate: description of a row's place, for messages.

    Raises:
        InputError: a cell is no time of day or no existing one, only some have a date, or a date
            such as 03/04/2026 has two readings in every row.
    """
    matches = [_STAMP.fullmatch(cell) for cell in cells]
    dates = {match["date"]: row for row, match in reversed([*enumerate(matches)]) if match}
    month_first = _is_month_first(dates, locate)
    ns = np.zeros(len(cells), dtype=np.int64)
    is_missing = np.array([cell in missing for cell in cells], dtype=bool)
    for row in np.flatnonzero(~is_missing).tolist():
        try:
            ns[row] = _nanoseconds(matches[row], month_first)
        except ValueError:
            problem = "A cell is not an existing time."
            raise _refusal(problem, cells[row], locate(row)) from None
    if None in dates and len(dates) > 1:
        row = max(dates[None], min(row for date, row in dates.items() if date))
        raise _refusal("Only some of the times have a date.", cells[row], locate(row))
    if None in dates:
        present = ns[~is_missing]
        present[1:] += _DAY_NS * np.cumsum(np.diff(present) < -_DAY_NS // 2)
        ns[~is_missing] = present
    return Stamps(ns, is_missing, None not in dates)


def _refusal(problem: str, cell: str, where: str) -> InputError:
    return InputError(
        problem,
        expected="times of day such as 10:00:00.125, or 2026-11-22T10:00:00.125 in every row",
        found=repr(cell[:40]),
        where=where,
        remedy="repair the cell, or give rate_hz if only the time stamps are wrong",
    )


def _is_month_first(dates: dict[str | None, int], locate: Locate) -> bool:
    """Tell the order of day and month in dates with slashes, which a number above 12 decides.

    ``dates``: as written → first row.
    """
    pairs = {
        date: [int(field) for field in date.split("/")[:2]]
        for date in dates
        if date and date[:3].count("/") == 1
    }
    if any(max(pair) > 12 for pair in pairs.values()):
        return not any(first > 12 for first, _ in pairs.values())
    for date, (first, second) in pairs.items():
        if first != second and 0 not in (first, second):
            month_day = f"{first} {_MONTHS[second - 1].title()}"
            raise InputError(
                "A date has two readings.",
                expected="dates such as 2026-11-22, or with a day above 12 in one row",
                found=f"{date}: {month_day}, or {second} {_MONTHS[first - 1].title()}",
                where=locate(dates[date]),
                remedy="export the times with dates as year-month-day, or give rate_hz",
            )
    return False


@functools.lru_cache(maxsize=64)
def _iso_date(date: str, month_first: bool) -> str:
    """Return a date as ISO 8601 has it; ValueError for one that overflows nanoseconds."""
    fields = re.split("[-/. ]", date.lower())
    if len(fields[0]) < 4:
        first, second, year = fields
        fields = [year, first, second] if month_first and "/" in date else fields[::-1]
    year, month, day = fields
    number = _MONTHS.index(month) + 1 if month in _MONTHS else int(month)
    if not _FIRST_YEAR <= int(year) <= _LAST_YEAR:
        raise ValueError(date)
    return f"{year}-{number:02d}-{int(day):02d}"


def _nanoseconds(match: re.Match[str] | None, month_first: bool) -> int:
    """Return the nanoseconds since 1970 UTC or midnight; ValueError for no existing time."""
    if match is None:
        raise ValueError("no time")
    hour = int(match["hour"])
    if match["half"]:
        if not 1 <= hour <= 12:
            raise ValueError(match[0])
        hour = hour % 12 + (12 if match["half"] in "Pp" else 0)
    date = _iso_date(match["date"] or "1970-01-01", month_first)
    time = f"{hour:02d}:{match['minute']}:{match['second']}{match['zone'] or '+00'}"
    since = datetime.datetime.fromisoformat(f"{date}T{time}") - _EPOCH
    fraction = (match["fraction"] or "")[:_FRACTION_DIGITS].ljust(_FRACTION_DIGITS, "0")
    return since // datetime.timedelta(seconds=1) * _SECOND_NS + int(fraction)

"""Times of day as text, with a date or without: ISO 8601, German and US dates, AM and PM, zones."""

from __future__ import annotations

import datetime
import functools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray

_DAY_NS = 86_400 * 10**9
_SECOND_NS = 10**9
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

    ns: NDArray[np.int64]
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


def parse_stamps(
    cells: Sequence[str], missing: frozenset[str], locate: Callable[[int], str]
) -> Stamps:
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
        match = matches[row]
        value = None if match is None else _nanoseconds(match, month_first)
        if value is None:
            raise _refusal("A cell is not an existing time.", cells[row], locate(row))
        ns[row] = value
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


def _is_month_first(dates: dict[str | None, int], locate: Callable[[int], str]) -> bool:
    """Tell the order of day and month in dates with slashes, which a number above 12 decides.

    ``dates``: as written → first row.
    """
    slashed = {date: row for date, row in dates.items() if date and date[:3].count("/") == 1}
    pairs = {date: [int(field) for field in date.split("/")[:2]] for date in slashed}
    if any(first > 12 for first, _ in pairs.values()):
        return False
    if any(second > 12 for _, second in pairs.values()):
        return True
    for date, (first, second) in pairs.items():
        if first != second and 0 not in (first, second):
            month_day = f"{first} {_MONTHS[second - 1].title()}"
            raise InputError(
                "A date has two readings.",
                expected="dates such as 2026-11-22, or with a day above 12 in one row",
                found=f"{date}: {month_day}, or {second} {_MONTHS[first - 1].title()}",
                where=locate(slashed[date]),
                remedy="export the times with dates as year-month-day, or give rate_hz",
            )
    return False


@functools.lru_cache(maxsize=64)
def _days(date: str, month_first: bool) -> int | None:
    """Return the days since 1970; None for a day that does not exist or overflows nanoseconds."""
    fields = re.split("[-/. ]", date.lower())
    year, month, day = fields if len(fields[0]) == 4 else fields[::-1]
    if month_first and "/" in date and len(fields[0]) < 4:
        day_of_month = month
        month = day
        day = day_of_month
    if month in _MONTHS:
        month = _MONTHS.index(month) + 1
    try:
        days = (datetime.date(int(year), int(month), int(day)) - datetime.date(1970, 1, 1)).days
    except ValueError:
        return None
    return days if _FIRST_YEAR <= int(year) <= _LAST_YEAR else None


def _nanoseconds(match: re.Match[str], month_first: bool) -> int | None:
    """Return the nanoseconds since 1970 UTC or midnight; None for a time that does not exist."""
    hour = int(match["hour"])
    minute = int(match["minute"])
    second = int(match["second"])
    if match["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if match["half"] in "Pp" else 0)
    days = _days(match["date"], month_first) if match["date"] else 0
    if days is None or hour > 23 or minute > 59 or second > 59:
        return None
    fraction = (match["fraction"] or "")[:_FRACTION_DIGITS].ljust(_FRACTION_DIGITS, "0")
    seconds = 3600 * hour + 60 * minute + second - _ahead_s(match["zone"] or "+00")
    return days * _DAY_NS + seconds * _SECOND_NS + int(fraction)


@functools.lru_cache(maxsize=16)
def _ahead_s(zone: str) -> int:
    """Return the seconds by which a zone is ahead of UTC."""
    digits = zone[1:].replace(":", "").ljust(4, "0")
    ahead_s = 3600 * int(digits[:2]) + 60 * int(digits[2:])
    return -ahead_s if zone[0] == "-" else ahead_s

"""Times of day as text, with a date or without: ISO 8601, German and US notation, AM and PM, time zones."""

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

_DAY_NS, _SECOND_NS = 86_400 * 10**9, 10**9
_DIGITS = 9  # of a fraction that count: nanoseconds
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_ZONES = frozenset({"", "z", "utc", "gmt"})
_STAMP = re.compile(
    r"(?:(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)"
    r"|(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4})"
    r"|(?P<first>\d\d?)/(?P<second>\d\d?)/(?P<slashed>\d{4})"
    r"|(?P<name_d>\d\d?)[- ](?P<name>[A-Za-z]{3})[- ](?P<name_y>\d{4})"
    r")(?:,? +|T))?"
    r"(?P<hour>\d\d?):(?P<minute>\d\d):(?P<seconds>\d\d)(?:[.,](?P<fraction>\d+))?"
    r"(?: ?(?P<half>[AaPp])\.?[Mm]\.?)?"
    r"(?: ?(?P<zone>Z|UTC|GMT|[+-]\d\d(?::?\d\d)?))?",
)
_REMEDY = "repair the cell, or give rate_hz if only the time stamps are wrong"


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
        missing: what stands for no value.
        locate: description of a row's place, for messages.

    Raises:
        InputError: a cell is no time of day or no existing one, only some have a date, or a date
            such as 03/04/2026 has two readings in every row.
    """
    matches = [_STAMP.fullmatch(cell) for cell in cells]
    month_first = _is_month_first(matches, locate)
    ns = np.zeros(len(cells), dtype=np.int64)
    is_missing = np.zeros(len(cells), dtype=bool)
    dated: bool | None = None
    for row, match in enumerate(matches):
        if match is None and cells[row] in missing:
            is_missing[row] = True
            continue
        value = None if match is None else _nanoseconds(match, month_first)
        if match is None or value is None:
            raise _refusal("A cell is not an existing time.", cells[row], locate(row))
        has_date = _date(match, month_first) is not None
        if dated not in (None, has_date):
            raise _refusal("Only some of the times have a date.", cells[row], locate(row))
        ns[row], dated = value, has_date
    if not dated:
        present = ns[~is_missing]
        present[1:] += _DAY_NS * np.cumsum(np.diff(present) < -_DAY_NS // 2)
        ns[~is_missing] = present
    return Stamps(ns, is_missing, bool(dated))


def _refusal(problem: str, cell: str, where: str) -> InputError:
    return InputError(
        problem,
        expected="times of day such as 10:00:00.125, or 2026-11-22T10:00:00.125 in every row",
        found=repr(cell[:40]),
        where=where,
        remedy=_REMEDY,
    )


def _is_month_first(matches: Sequence[re.Match[str] | None], locate: Callable[[int], str]) -> bool:
    """Tell the order of day and month in dates with slashes, which one row above 12 decides."""
    pairs: dict[tuple[int, int], int] = {}
    for row, match in enumerate(matches):
        if match and match["first"]:
            pairs.setdefault((int(match["first"]), int(match["second"])), row)
    if any(first > 12 for first, _ in pairs):
        return False
    if all(first == second for first, second in pairs) or any(second > 12 for _, second in pairs):
        return True
    (first, second), row = next((pair, row) for pair, row in pairs.items() if pair[0] != pair[1])
    raise InputError(
        "A date has two readings.",
        expected="dates such as 2026-11-22, or with a day above 12 in one row",
        found=f"{first:02d}/{second:02d}: {first} {_MONTHS[second - 1].title()}, "
        f"or {second} {_MONTHS[first - 1].title()}",
        where=locate(row),
        remedy="export the times with dates as year-month-day, or give rate_hz",
    )


def _date(match: re.Match[str], month_first: bool) -> tuple[int, int, int] | None:
    """Return year, month and day; None without a date."""
    if match["year"]:
        return int(match["year"]), int(match["month"]), int(match["day"])
    if match["y"]:
        return int(match["y"]), int(match["m"]), int(match["d"])
    if match["name"]:
        name = match["name"].lower()
        month = _MONTHS.index(name) + 1 if name in _MONTHS else 0
        return int(match["name_y"]), month, int(match["name_d"])
    if match["slashed"]:
        first, second = int(match["first"]), int(match["second"])
        month, day = (first, second) if month_first else (second, first)
        return int(match["slashed"]), month, day
    return None


@functools.lru_cache(maxsize=64)
def _days(date: tuple[int, int, int]) -> int | None:
    """Return the days since 1970; None for a day that does not exist or overflows nanoseconds."""
    try:
        days = (datetime.date(*date) - datetime.date(1970, 1, 1)).days
    except ValueError:
        return None
    return days if 1678 <= date[0] <= 2261 else None


def _nanoseconds(match: re.Match[str], month_first: bool) -> int | None:
    """Return the nanoseconds since 1970 UTC or midnight; None for a time that does not exist."""
    hour, minute, second = int(match["hour"]), int(match["minute"]), int(match["seconds"])
    if match["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if match["half"] in "Pp" else 0)
    date = _date(match, month_first)
    days = 0 if date is None else _days(date)
    if days is None or hour > 23 or minute > 59 or second > 59:
        return None
    fraction = (match["fraction"] or "")[:_DIGITS].ljust(_DIGITS, "0")
    seconds = 3600 * hour + 60 * minute + second - _offset_s(match["zone"] or "")
    return days * _DAY_NS + seconds * _SECOND_NS + int(fraction)


@functools.lru_cache(maxsize=16)
def _offset_s(zone: str) -> int:
    """Return the seconds by which a zone is ahead of UTC."""
    if zone.lower() in _ZONES:
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    offset_s = 3600 * int(digits[:2]) + 60 * int(digits[2:])
    return -offset_s if zone[0] == "-" else offset_s

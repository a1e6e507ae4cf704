"""Times of day and dates in text files, as seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from vibrident.records import FloatArray

_STAMP = re.compile(
    r"(?:(?P<year>\d{4})[-/.](?P<month>\d\d)[-/.](?P<day>\d\d)[ T]+|(?P<d>\d\d)\.(?P<m>\d\d)\.(?P<y>\d{4})[ T]+)?"
    r"(?P<time>\d\d:\d\d:\d\d)(?:[.,](?P<fraction>\d{1,9}))?Z?"
)
_DAY_S = 86400.0


def is_stamp(cell: str) -> bool:
    """Whether a cell holds a time of day, with or without a date (year-month-day, or day.month.year)."""
    return _STAMP.fullmatch(cell) is not None


def seconds_of_stamps(cells: Sequence[str]) -> FloatArray:
    """Seconds since the first stamp, shape (cells,); NaN where a cell holds none. Midnight is passed forwards.

    Raises:
        ValueError: a date does not exist.
    """
    texts, dated = ["NaT"] * len(cells), False
    for index, cell in enumerate(cells):
        found = _STAMP.fullmatch(cell)
        if found is None:
            continue
        part = found.groupdict()
        day = "1970-01-01"
        if part["year"] or part["y"]:
            day, dated = f"{part['year'] or part['y']}-{part['month'] or part['m']}-{part['day'] or part['d']}", True
        texts[index] = f"{day}T{part['time']}.{part['fraction'] or '0'}"
    stamps = np.array(texts, dtype="datetime64[ns]")
    seconds = (stamps - stamps[:1]) / np.timedelta64(1, "s")  # subtracted first, to keep the digits
    if not dated:
        seconds[1:] += _DAY_S * np.cumsum(np.diff(seconds) < -0.5 * _DAY_S)
    return np.asarray(seconds, dtype=np.float64)

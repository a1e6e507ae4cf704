"""Names by which files state a rate, an interval, a start or a unit, and what their values mean.

Attributes of HDF5, variables of MATLAB, metadata of Parquet and properties of TDMS have no fixed
names for these. One list serves all, whatever the case, blanks and signs between the words.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.columns import Clock, StartTime
from vibrident.data.io.header_units import is_time
from vibrident.data.io.sampling import SAME_RATE, plainest_clock
from vibrident.data.io.text_head import GENERIC_NAMES
from vibrident.data.io.units import factor_between
from vibrident.data.io.vocabulary import VOCABULARY


def _plain_word(name: str) -> str:
    """Return a name in lower case without blanks and signs."""
    return re.sub(r"[\W_]", "", name.lower())


_SPELLED: dict[str, str] = VOCABULARY["metadata_spelled"]
#: Names of metadata, and the keys of heads of text files that say by themselves what they are of.
_MEANINGS = {word: meaning for meaning, words in VOCABULARY["metadata"].items() for word in words}
_MEANINGS |= {
    word: meaning
    for meaning, key in (("rate", "rate"), ("interval", "interval"), ("unit", "units"))
    for word in map(_plain_word, {*VOCABULARY["head"][key]} - GENERIC_NAMES)
    if len(word) > 2
}
_SUFFIXES: dict[str, float] = VOCABULARY["metadata_suffixes"]
_SPELLED_NAME = re.compile(r"([^\W_])_?([^\W_])[ _(\[]*(k?[Hh]z|[mun]?s)?[)\]]?")
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s\d]*)\s*")
_DATE = re.compile(
    r"(\d{4}-\d\d-\d\d)(?:[T ]+(\d\d:\d\d(?::\d\d(?:\.\d+)?)?))?\s*(?:Z|UTC|([-+]\d\d):?(\d\d))?"
)
_MAX_NAME_LENGTH = 100
#: A rate and an interval that differ less are one statement: files round intervals to four digits.
_MAX_ROUNDING = 5e-4


@dataclass(frozen=True)
class Statement:
    """A rate, an interval, a start or a unit that a file states under a name of its own."""

    name: str
    value: Any
    factor: float  # of the unit in the name, to Hz or s


#: Statements about a column, or about what holds it, by meaning; and those at several levels.
Level = Mapping[str, Statement]
Levels = Sequence[Level]


def meaning_of(name: str) -> tuple[str, float]:
    """Return what a name states, and the factor of a unit at its end.

    The first is "rate", "interval", "start", "unit", "unit a" for the unit of a column a, or "" for
    a name that states none of these.
    """
    name = name.strip()
    if len(name) > _MAX_NAME_LENGTH:
        return "", 1.0
    spelled = _SPELLED_NAME.fullmatch(name)
    if spelled is not None and spelled[1] + spelled[2] in _SPELLED:
        return _SPELLED[spelled[1] + spelled[2]], _SUFFIXES[(spelled[3] or "s").lower()]
    word = _plain_word(name)
    if word in _MEANINGS:
        return _MEANINGS[word], 1.0
    for suffix, factor in _SUFFIXES.items():
        stem = word.removesuffix(suffix)
        if stem != word and (meaning := _MEANINGS.get(stem.removesuffix("in"))):
            return meaning, factor  # "sampling_frequency_in_hz"
    column = re.fullmatch(r"(.+)units?", word)
    return (f"unit {column[1]}", 1.0) if column else ("", 1.0)


def statements(values: Mapping[str, Any]) -> dict[str, Statement]:
    """Return what named values of a file state, by meaning; the first of several of one counts."""
    by_meaning: dict[str, Statement] = {}
    for name, value in values.items():
        meaning, factor = meaning_of(name)
        if meaning:
            by_meaning.setdefault(meaning, Statement(name, value, factor))
    return by_meaning


def clock_of(levels: Levels, where: str) -> Clock | None:
    """Return the clock that a file states for a column; None without a rate or an interval.

    ``levels``: statements about the column, nearest first, each hiding those behind it; ``where``:
    the column, for messages. InputError: the rate is no finite number above 0, or the interval
    beside it is of another rate.
    """
    level = next((level for level in levels if {"rate", "interval"} & level.keys()), {})
    rate = level.get("rate")
    interval = level.get("interval")
    interval_s = None if interval is None else _positive(interval, where)
    start = start_of(levels)
    if rate is None:
        if interval is None or interval_s is None:
            return None
        half_unit_s = _half_spacing(interval)
        if half_unit_s:
            return plainest_clock(interval_s, half_unit_s, start)
        return Clock(1.0 / interval_s, start=start)
    rate_hz = _positive(rate, where)
    difference = 0.0 if interval_s is None else abs(rate_hz * interval_s - 1.0)
    if interval is not None and difference > _MAX_ROUNDING:
        raise _unusable(
            "The file states two sampling rates.",
            f"{interval.name} to be 1/{rate.name}",
            f"{rate.name} = {rate.value!r} and {interval.name} = {interval.value!r}",
            where,
        )
    rounding = max(SAME_RATE, difference, _half_spacing(rate) / rate_hz)
    return Clock(rate_hz, rounding, start)


def start_of(levels: Levels) -> StartTime | None:
    """Return the start that a file states: a date, or seconds on its own clock; None if neither."""
    statement = next((level["start"] for level in levels if "start" in level), None)
    value = None if statement is None else scalar(statement.value)
    if statement is None or value is None:
        return None
    if isinstance(value, str) and (start := _date(value)):
        return start
    seconds = _number(value) * statement.factor
    return StartTime.on_own_clock(seconds) if math.isfinite(seconds) else None


def _date(text: str) -> StartTime | None:
    """Return the start of a date of ISO 8601, UTC where it names no zone; None for no date."""
    date = _DATE.fullmatch(text.strip())
    if date is None:
        return None
    day, time, hours, minutes = date.groups()
    try:
        instant = np.datetime64(f"{day}T{time or '00:00'}", "ns")
    except ValueError:
        return None
    east_minutes = int(f"{hours[0]}{60 * int(hours[1:]) + int(minutes)}") if hours else 0
    return StartTime.on_date(instant, -60.0 * east_minutes)


def seconds_since(unit: str) -> tuple[float, StartTime] | None:
    """Return seconds per unit and the start of "milliseconds since 2024-05-01 12:00", else None."""
    amount, _, day = unit.partition(" since ")
    factor = factor_between(amount, "s")
    start = _date(day)
    return None if factor is None or start is None else (factor, start)


def unit_of(level: Level, index: int = 0, count: int = 1) -> str:
    """Return the stated unit of a column; "" if none.

    Several units state those of as many columns: ``index`` of ``count``. Of another number, it is
    not known which is meant: all of them.
    """
    if "unit" not in level:
        return ""
    several = np.asarray(level["unit"].value, dtype=object).reshape(-1)
    if several.size == count and index < count:
        several = several[index : index + 1]
    texts = [text.strip("\0 \t\r\n") for item in several if isinstance(text := scalar(item), str)]
    return " or ".join(dict.fromkeys(texts))


def nearest_unit(
    name: str,
    own_statements: Level,
    outer: Level,
    index: int = 0,
    count: int = 1,
) -> str:
    """Return the unit of a column by its own statements, or by those of what holds it.

    The unit of a group, a structure or a file is that of its columns, but for times and
    frequencies. ``index``, ``count``: as ``unit_of``.
    """
    unit = unit_of(own_statements, index, count)
    of_column = outer.get(f"unit {_plain_word(name)}")
    if not unit and of_column is not None:
        unit = unit_of({"unit": of_column}, index, count)
    if unit or is_time(name) or is_frequency(name, ""):
        return unit
    return unit_of(outer, index, count)


def is_frequency(name: str, unit: str) -> bool:
    """Return whether an axis of this name and unit is one of frequencies."""
    word = name.strip().lower()
    has_kind = any(
        factor_between(unit, frequency_unit) is not None for frequency_unit in ("Hz", "rad/s")
    )
    return has_kind or word.startswith("freq") or word == "f"


def scalar(value: Any) -> Any:
    """Return the only item of a value, bytes as text; None for several or none."""
    if isinstance(value, np.ndarray | list | tuple):
        array = np.asarray(value)
        if array.size != 1:
            return None
        value = array.reshape(-1)[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _number(value: Any) -> float:
    """Return a number, or that of a text with a unit such as "51.2 kHz"; NaN for another value."""
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value)
        factor = _SUFFIXES.get(match[2].lower() or "s") if match else None
        return math.nan if match is None or factor is None else float(match[1]) * factor
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.number):
        return math.nan
    return math.nan if isinstance(value, np.complexfloating) else float(value)


def _positive(statement: Statement, where: str) -> float:
    """Return a stated rate or interval in Hz or s; InputError where it is no number above 0."""
    single_value = scalar(statement.value)
    value = _number(single_value) * statement.factor
    if math.isfinite(value) and value > 0 and math.isfinite(1.0 / value):
        return value
    raise _unusable(
        "The sampling rate in the file's metadata cannot be used.",
        f"{statement.name} to be a finite number above 0",
        repr(statement.value if single_value is None else single_value)[:_MAX_NAME_LENGTH],
        where,
    )


def _unusable(problem: str, expected: str, value: str, where: str) -> InputError:
    remedy = "correct the metadata, or write the file without it and give rate_hz"
    return InputError(problem, expected=expected, found=value, where=where, remedy=remedy)


def _half_spacing(statement: Statement) -> float:
    """Return how far a fraction in four bytes may be from what was meant; 0 for other numbers."""
    number = scalar(statement.value)
    if type(number) is np.float32 and number != round(number):
        return float(np.spacing(number)) / 2 * statement.factor
    return 0.0

"""A column of a response table, and the unit that its file states for it.

A unit stands in a format's own field, in a row below the names, or in a name: "S [mV/g]",
"f / kHz", "phase_deg", "S in dB re 1 V/(m/s²)", "S_mV_per_g", "mV/g".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from vibrident.data.io.header_units import SourceColumn, short_name
from vibrident.data.io.units import (
    is_no_unit,
    parse_unit,
    split_unit,
    without_brackets,
)

RELATIVE_UNITS = {"%": 1e-2, "percent": 1e-2, "prozent": 1e-2, "ppm": 1e-6}
_SUFFIX = re.compile(r"[\w)\]|][_.\s-]+((?:k?rad_s)|[^\W\d_]+|%|°)$")
_PER = re.compile(r"(?:^|[_\s])([^\W_]+)_per_(\w+)$")
_NUMBER_BEFORE = re.compile(
    r"[x×*]?\s*\d+(?:[.,]\d+)?(?:\^?[eE]?[+-−⁻]?[\d⁰¹²³⁴-⁹]+)?\s*[x×*·]?\s*"
)
_COVERAGE = re.compile(r"[,;\s]*\(?\bk\s*=\s*\d+(?:[.,]\d+)?\b\)?\s*$", re.IGNORECASE)
_LEVEL = re.compile(r"(?:^|(?<=[\s_(\[/,]))(?:dB|db(?![a-z])).*$")
_REFERENCE_OF_LEVEL = re.compile(
    r"d[bB][\s,:]*\(?\s*(?:(?:re|ref|rel|bez)\b\.?:?|//)?\s*"
    r"(?P<number>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?(?![/\d]))?\s*(?P<unit>.*)"
)


@dataclass(frozen=True)
class Level:
    """A unit in decibels: 20 lg of a value over ``number`` times ``unit``."""

    text: str  # as the file states it
    number: float
    unit: str  # "" for none


class TableColumn(SourceColumn):
    """A column that a key of [table] names."""

    @property
    def asked_for_by(self) -> str:
        """Return the key as messages print it."""
        return f"[table] {self.key}"

    @property
    def name(self) -> str:
        """Return the name without its path and without "k = 2"; "" for a very long one."""
        return _COVERAGE.sub("", short_name(self.last_name))

    @property
    def stated_unit(self) -> str:
        """Return the unit that the file states beside the name; "" for none."""
        text = self.source.stated_unit(self.position)
        return "" if is_no_unit(text) else without_brackets(text.strip())

    def units(self) -> Iterator[tuple[str, bool]]:
        """Yield the texts that may be the unit, likeliest first, and whether each is surely one."""
        unit = self.stated_unit or split_unit(self.name)[1]
        number = _NUMBER_BEFORE.match(unit)
        if number and parse_unit(unit) is None and parse_unit(unit[number.end() :]) is not None:
            remedy = "multiply the column by it, and write the unit alone into the header"
            raise self.refused("a unit without a number in front of it", unit, remedy)
        if len(self.name) > 1 and not self.stated_unit:
            yield self.name, False
        if unit:
            yield unit, True
        if self.stated_unit:
            return
        if match := _SUFFIX.search(self.name):
            yield match[1].replace("_", "/"), False

    def level(self) -> Level | None:
        """Return the unit in decibels; None for another; InputError for an unknown reference."""
        match = _LEVEL.search(self.stated_unit or self.name)
        if match is None:
            return None
        text = _without_odd_bracket(match.group(0))
        reference = _REFERENCE_OF_LEVEL.fullmatch(text)
        assert reference is not None
        unit = _without_odd_bracket(reference["unit"])
        if unit == "m" or (unit and parse_unit(unit) is None):  # dBm is a power
            raise self.refused(
                "dB re a known unit",
                text,
                "write the reference as a unit, such as dB re 1 V/(m/s²); or dB alone, and as "
                "[response] scale what 0 dB stands for",
            )
        return Level(text, float((reference["number"] or "1").replace(",", ".")), unit)


def _without_odd_bracket(text: str) -> str:
    """Take off a last bracket that was opened in front of the text."""
    text = text.strip()
    for opened, closed in ("()", "[]", "{}", "<>"):
        if text.endswith(closed) and text.count(closed) > text.count(opened):
            return _without_odd_bracket(text[:-1])
    return text


def per_unit_in(name: str) -> str:
    """Return the unit in a name such as "S_mV_per_g"; "" for none."""
    match = _PER.search(name)
    text = f"{match[1]}/({match[2].replace('_', '/')})" if match else ""
    return text if parse_unit(text) is not None else ""

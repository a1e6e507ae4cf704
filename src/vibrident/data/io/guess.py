"""Guess the meaning of a data file's columns from their names, for a person to confirm."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError
from vibrident.data.io.clocks import file_clock
from vibrident.data.io.columns import ColumnFile
from vibrident.data.io.header_units import is_time
from vibrident.data.io.reader import open_columns
from vibrident.data.io.table_column import TableColumn
from vibrident.data.io.table_units import stated_sensitivity
from vibrident.data.io.units import quantity_of
from vibrident.data.io.vocabulary import VOCABULARY

_FREQUENCY = re.compile(r"f|freq.*|frequenz.*", re.IGNORECASE)
_MAGNITUDE = re.compile(r"mag(nitude)?|abs.*|ampl.*|sens.*|betrag.*", re.IGNORECASE)
_PHASE = re.compile(r"(phase|phi|arg)", re.IGNORECASE)
_UNCERTAIN = re.compile(r"unc|sigma|std|unsicherheit|(^|[_\s])(?-i:u)([_\s(]|$)", re.IGNORECASE)
#: Not standard uncertainties.
_EXPANDED = re.compile(r"expanded|erweitert|(^|[_\s])(?-i:U)([_\s(/]|$)", re.IGNORECASE)
#: Words in a reference's name, the surest first, and their quantities; "" for none.
_REFERENCES = [(re.compile(p, re.IGNORECASE), q) for p, q in VOCABULARY["guess"]["references"]]
#: Names of photodetector signals: cos and sin of the phase, each with the name of its partner.
_DETECTORS: list[list[str]] = VOCABULARY["guess"]["detectors"]
_CARRIER = re.compile(r"hetero|beat|carrier", re.IGNORECASE)
_RESPONSE = re.compile(
    r"resp|out|dut|sensor|volt|charge|signal|laser|pickup|"
    r"antwort|ausgang|prüfling|spannung|ladung|\bu\b",
    re.IGNORECASE,
)
#: Columns that number the rows.
_INDEX = re.compile(r"(nr|no|nummer|number|index|samples?|row|zeile|#)\.?", re.IGNORECASE)
_BRACKETS = re.compile(r"[\[(]((?:\([^()]*\)|[^\])])+)[\])]")
#: In brackets, a channel's number is no unit.
_CHANNEL = re.compile(
    r"(?:ch(?:an(?:nel)?)?|kanal|ai|in(?:put)?|no|nr|#)?[\s._:#/-]*\d+", re.IGNORECASE
)
_MAX_NAME_LENGTH = 200
_EXCITATIONS = [(re.compile(p, re.IGNORECASE), e) for p, e in VOCABULARY["guess"]["excitations"]]


@dataclass(frozen=True)
class Columns:
    """Columns of a file, and the parts of a calibration document that their names tell.

    Attributes:
        columns: names of the columns, or numbers of those whose name is not unique, in the order of
            the file.
        labels: the same, for display.
        rate_hz: rate that the file states; None if none.
        document: section → key → value; of [[records]] what all entries share.
    """

    columns: tuple[int | str, ...]
    labels: tuple[str, ...]
    rate_hz: float | None
    document: Mapping[str, Mapping[str, Any]]

    @property
    def is_table(self) -> bool:
        """Return whether the names are those of a tabulated response."""
        return {"frequency", "magnitude"} <= self.document["table"].keys()

    @property
    def time(self) -> int | str | None:
        """Return the column of the times; None if there is none, or the file states its rate."""
        return self.document["sampling"].get("time_column")


def guess_columns(path: Path) -> Columns:
    """Open a data file and guess the meaning of its columns from their names, without its numbers.

    Raises:
        InputError: the file cannot be opened, or has no column that can be chosen.
    """
    source = open_columns(path)
    choices = _choices(source)
    units = map(source.stated_unit, range(len(source.names)))
    pairs = zip(source.names, units, strict=True)
    names = [f"{name} [{unit}]" if unit else name for name, unit in pairs]
    free = [p for p, name in enumerate(names) if not _INDEX.fullmatch(name.strip())]
    clocks = (file_clock(source, position) for position in free)
    clock = next(filter(None, clocks), None)
    time = next((p for p in free if is_time(names[p])), None) if clock is None else None
    free = [position for position in free if position != time]
    detectors = _detectors(names, free)
    free = [position for position in free if position not in detectors]
    reference, quantity = (None, None) if detectors else _reference(names, free)
    free = [position for position in free if position != reference]
    response = _first(names, free, _RESPONSE)
    if response is None and free:
        response = free[0]
    if reference is None and not detectors and len(free) > 1:
        reference, response = free[:2]
    unit = _unit(names, reference)
    response_unit = _unit(names, response)
    table = _table(names)
    if {"frequency", "magnitude"} <= table.keys():
        response_unit, quantity = _sensitivity(source, table["magnitude"])
        unit = ""
    kind = {1: "heterodyne", 2: "quadrature"}.get(len(detectors))
    excitation = next((kind for name, kind in _EXCITATIONS if name.search(path.stem)), None)
    document: dict[str, dict[str, Any]] = {
        "reference": {
            "column": choices.get(reference),
            "quantity": quantity_of(unit) or quantity or "acceleration",
            "scale": 1.0,
            "unit": unit,
        },
        "interferometer": {
            "kind": kind,
            "columns": [choices[position] for position in detectors] or None,
        },
        "response": {"column": choices.get(response), "scale": 1.0, "unit": response_unit or "V"},
        "sampling": {"time_column": choices.get(time)},
        "records": {"excitation": excitation},
        "table": {key: choices.get(position) for key, position in table.items()},
    }
    for section, keys in document.items():
        document[section] = {key: value for key, value in keys.items() if value is not None}
    return Columns(
        columns=tuple(choices.values()),
        labels=tuple(_label(names[p], c) for p, c in choices.items() if p is not None),
        rate_hz=None if clock is None else clock.rate_hz,
        document=document,
    )


def _sensitivity(source: ColumnFile, position: int) -> tuple[str, str]:
    """Return unit of the response and quantity in a magnitude's unit; "" for what is unknown."""
    with contextlib.suppress(InputError):
        return stated_sensitivity(TableColumn(source, position, "magnitude"))
    return "", ""


def _choices(source: ColumnFile) -> dict[int | None, int | str]:
    """Return position → name, or number where names are not unique, of what can be chosen."""
    names = source.names
    choices: dict[int | None, int | str] = {}
    for position, name in enumerate(names):
        if name and names.count(name) == 1:
            choices[position] = name
        elif position in source.numbered:
            choices[position] = source.numbered.index(position) + 1
    if not choices:
        raise InputError(
            "The file has no column that can be chosen.",
            expected="columns of numbers with unique names",
            found=f"{len(names)} columns without names",
            where=source.file,
            remedy="export the data with a header",
        )
    return choices


def _label(name: str, column: int | str) -> str:
    if isinstance(column, str):
        return column
    return f"column {column}" + (f" ({name})" if name else "")


def _first(names: Sequence[str], positions: Iterable[int], pattern: re.Pattern[str]) -> int | None:
    """Return the first position whose name holds a pattern; None if there is none."""
    return next((p for p in positions if names[p] and pattern.search(names[p].strip())), None)


def _reference(names: Sequence[str], positions: Sequence[int]) -> tuple[int | None, str | None]:
    """Return the position of the reference and its quantity, each None if no name tells."""
    for pattern, quantity in _REFERENCES:
        position = _first(names, positions, pattern)
        if position is not None:
            matches = (
                q for name_pattern, q in _REFERENCES if q and name_pattern.search(names[position])
            )
            return position, quantity or next(matches, None)
    return None, None


def _detectors(names: Sequence[str], positions: Sequence[int]) -> tuple[int, ...]:
    """Return two signals in quadrature, one on a carrier, or none, of columns with unique names."""
    plain_names = {
        p: _BRACKETS.sub("", names[p][:_MAX_NAME_LENGTH]).strip()
        for p in positions
        if names.count(names[p]) == 1
    }

    def first_match(pattern: str) -> int | None:
        matches = (p for p, n in plain_names.items() if re.fullmatch(pattern, n, re.IGNORECASE))
        return next(matches, None)

    for cosine_pattern, sine_pattern in _DETECTORS:
        cosine = first_match(cosine_pattern)
        sine = first_match(sine_pattern)
        if cosine is not None and sine is not None:
            return cosine, sine
    return tuple(p for p, name in plain_names.items() if _CARRIER.search(name))[:1]


def _unit(names: Sequence[str], position: int | None) -> str:
    """Return the text in brackets in a name that is no channel number; "" if there is none."""
    texts = [] if position is None else _BRACKETS.findall(names[position][:_MAX_NAME_LENGTH])
    return next((text for text in map(str.strip, texts) if not _CHANNEL.fullmatch(text)), "")


def _table(names: Sequence[str]) -> dict[str, int]:
    """Return key of [table] → position, as far as the names tell."""
    stated = [p for p, name in enumerate(names) if not _EXPANDED.search(name)]
    uncertainties = [p for p in stated if _UNCERTAIN.search(names[p])]
    values = [p for p in stated if p not in uncertainties]
    ways = (
        ("frequency", values, _FREQUENCY.match),
        ("magnitude", values, _MAGNITUDE.match),
        ("phase", values, _PHASE.match),
        ("magnitude_uncertainty", uncertainties, _MAGNITUDE.search),
        ("phase_uncertainty", uncertainties, _PHASE.search),
    )
    positions = {
        key: next((p for p in candidates if matches(names[p])), None)
        for key, candidates, matches in ways
    }
    return {key: position for key, position in positions.items() if position is not None}

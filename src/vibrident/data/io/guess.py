"""The possible meaning of a data file's columns, guessed from their names, for a person to confirm."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.data.io.columns import ColumnFile
from vibrident.data.io.header_units import is_time
from vibrident.data.io.reader import open_columns
from vibrident.data.io.units import quantity_of

_FREQUENCY = re.compile(r"f|freq.*|frequenz.*", re.IGNORECASE)
_MAGNITUDE = re.compile(r"mag(nitude)?|abs.*|ampl.*|sens.*|betrag.*", re.IGNORECASE)
_PHASE = re.compile(r"(phase|phi|arg)", re.IGNORECASE)
_UNCERTAIN = re.compile(r"unc|sigma|std|unsicherheit|(^|[_\s])(?-i:u)([_\s(]|$)", re.IGNORECASE)
#: Not standard uncertainties, or not in the column's unit.
_EXPANDED = re.compile(r"expanded|erweitert|%|(^|[_\s])(?-i:U)([_\s(/]|$)", re.IGNORECASE)
#: Words in a reference's name, the surest first, and their quantities.
_REFERENCES = (
    (re.compile(r"ref|bezug", re.IGNORECASE), None),
    (re.compile(r"acc|beschl|a_in|m/s[\^]?2|m/s²", re.IGNORECASE), "acceleration"),
    (re.compile(r"vel|geschw|vibrometer", re.IGNORECASE), "velocity"),
    (re.compile(r"drive|gen|excit|anregung|input", re.IGNORECASE), "drive"),
    (re.compile(r"disp|interferom|laser|weg", re.IGNORECASE), "displacement"),
)
#: Names of photodetector signals: cos and sin of the phase, each with the name of its partner.
_DETECTORS = (
    (r"(u|pd|det\w*?|photo\w*?|quad\w*?)[ _]?1", r"(u|pd|det\w*?|photo\w*?|quad\w*?)[ _]?2"),
    (r"cos\w*", r"sin\w*"),
    (r"i|in[ _-]?phase", r"q|quadrature"),
)
_CARRIER = re.compile(r"hetero|beat|carrier", re.IGNORECASE)
_RESPONSE = re.compile(
    r"resp|out|dut|sensor|volt|charge|signal|laser|pickup|antwort|ausgang|prüfling|spannung|ladung|\bu\b",
    re.IGNORECASE,
)
#: Columns that number the rows.
_INDEX = re.compile(r"(nr|no|nummer|number|index|samples?|row|zeile|#)\.?", re.IGNORECASE)
_BRACKETS = re.compile(r"[\[(]((?:\([^()]*\)|[^\])])+)[\])]")
#: A sensitivity's unit: of the response, and of the motion in SI.
_SENSITIVITY = re.compile(r"(.+?)/\(?(m(?:/s(?:\^?2|²)?)?)\)?")
#: In brackets, a channel's number is no unit.
_CHANNEL = re.compile(
    r"(?:ch(?:an(?:nel)?)?|kanal|ai|in(?:put)?|no|nr|#)?[\s._:#/-]*\d+", re.IGNORECASE
)
_LONGEST_NAME = 200
_EXCITATIONS = (
    ("multisine", re.compile(r"multi", re.IGNORECASE)),
    ("sweep", re.compile(r"sweep|chirp", re.IGNORECASE)),
    ("random", re.compile(r"random|noise|rausch", re.IGNORECASE)),
    ("shock", re.compile(r"shock|impact|hammer|stoss|stoß", re.IGNORECASE)),
    ("decay", re.compile(r"decay|free|damping", re.IGNORECASE)),
)


@dataclass(frozen=True)
class Columns:
    """Columns of a file, and their possible meaning; a column is its name, or its number if that is not unique."""

    columns: tuple[int | str, ...]  # the choices, in the order of the file
    labels: tuple[str, ...]  # the same, for display
    rate_hz: float | None  # that the file itself states
    # time, reference, response: of records
    time: int | str | None
    reference: int | str | None
    response: int | str | None
    # frequency, magnitude, phase, magnitude_uncertainty, phase_uncertainty: of a tabulated response, if frequency and
    # magnitude are known
    frequency: int | str | None
    magnitude: int | str | None
    phase: int | str | None
    magnitude_uncertainty: int | str | None
    phase_uncertainty: int | str | None
    # quantity, scale, unit: of the reference; scale leads to SI
    quantity: str
    scale: float
    unit: str
    response_unit: str  # of the response
    excitation: str | None  # by the file's name; None if undetermined
    # photodetector signals of an interferometer: two in quadrature, one on a carrier, or none
    detectors: tuple[int | str, ...] = ()

    @property
    def is_table(self) -> bool:
        """Whether the names are those of a tabulated response."""
        return self.frequency is not None and self.magnitude is not None


def guess_columns(path: Path) -> Columns:
    """Open a data file and guess the meaning of its columns from their names; its numbers are not read."""
    source = open_columns(path)
    own = source.names
    columns = tuple(
        own[p] if own[p] and own.count(own[p]) == 1 else source.numbered.index(p) + 1
        for p in _positions(source)
    )
    if not columns:
        raise InputError(
            "The file has no column that can be chosen.",
            expected="columns of numbers with unique names",
            found=f"{len(source.names)} columns without names",
            where=source.file,
            remedy="export the data with a header",
        )
    units = [source.stated_unit(p) for p in range(len(source.names))]
    names = tuple(
        f"{name} [{unit}]" if unit else name for name, unit in zip(source.names, units, strict=True)
    )
    free = [p for p, name in enumerate(names) if not _INDEX.fullmatch(name.strip())]
    table = _table(names)
    clock = next((c for c in map(source.clock, free) if c is not None), None)
    time = next((p for p in free if is_time(names[p])), None) if clock is None else None
    if time is not None:
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
    unit, response_unit = _unit(names, reference), _unit(names, response)
    if table["frequency"] is not None and (
        per := _SENSITIVITY.fullmatch(_unit(names, table["magnitude"]))
    ):
        response_unit, unit = per.groups()
    quantity = quantity_of(unit) or quantity or "acceleration"
    chosen = dict(zip(_positions(source), columns, strict=True))

    def column(position: int | None) -> int | str | None:
        return None if position is None else chosen.get(position)

    return Columns(
        columns=columns,
        labels=tuple(_label(names[p], c) for p, c in chosen.items()),
        rate_hz=None if clock is None else clock.rate_hz,
        time=column(time),
        reference=column(reference),
        response=column(response),
        **{name: column(position) for name, position in table.items()},
        quantity=quantity,
        scale=1.0,
        unit=unit,
        response_unit=response_unit or "V",
        excitation=next((name for name, words in _EXCITATIONS if words.search(path.stem)), None),
        detectors=tuple(chosen[position] for position in detectors),
    )


def _positions(source: ColumnFile) -> list[int]:
    names = source.names
    return [
        p
        for p in range(len(names))
        if p in source.numbered or (names[p] and names.count(names[p]) == 1)
    ]


def _label(name: str, column: int | str) -> str:
    if isinstance(column, str):
        return column
    return f"column {column}" + (f" ({name})" if name else "")


def _first(names: Sequence[str], positions: Sequence[int], words: re.Pattern[str]) -> int | None:
    return next(
        (
            position
            for position in positions
            if names[position] and words.search(names[position].strip())
        ),
        None,
    )


def _reference(names: Sequence[str], positions: Sequence[int]) -> tuple[int | None, str | None]:
    for words, quantity in _REFERENCES:
        position = _first(names, positions, words)
        if position is not None:
            return position, quantity or next(
                (q for w, q in _REFERENCES if q and w.search(names[position])), None
            )
    return None, None


def _detectors(names: Sequence[str], positions: Sequence[int]) -> tuple[int, ...]:
    """Two signals in quadrature, one on a carrier, or none; only columns that can be chosen by their names."""
    plain = {
        p: _BRACKETS.sub("", names[p][:_LONGEST_NAME]).strip()
        for p in positions
        if names.count(names[p]) == 1
    }
    for both in _DETECTORS:
        pair = [
            next((p for p, n in plain.items() if re.fullmatch(words, n, re.IGNORECASE)), None)
            for words in both
        ]
        if pair[0] is not None and pair[1] is not None:
            return pair[0], pair[1]
    return tuple(p for p, name in plain.items() if _CARRIER.search(name))[:1]


def _unit(names: Sequence[str], position: int | None) -> str:
    found = [] if position is None else _BRACKETS.findall(names[position][:_LONGEST_NAME])
    return next((text for text in map(str.strip, found) if not _CHANNEL.fullmatch(text)), "")


def _table(names: Sequence[str]) -> dict[str, int | None]:
    every = range(len(names))
    sure = [p for p in every if not (_UNCERTAIN.search(names[p]) or _EXPANDED.search(names[p]))]
    doubts = [p for p in every if _UNCERTAIN.search(names[p]) and not _EXPANDED.search(names[p])]
    keys = {"frequency": _FREQUENCY, "magnitude": _MAGNITUDE, "phase": _PHASE}
    found = {
        key: next((p for p in sure if words.match(names[p])), None) for key, words in keys.items()
    }
    for key, words in (("magnitude", _MAGNITUDE), ("phase", _PHASE)):
        found[f"{key}_uncertainty"] = next((p for p in doubts if words.search(names[p])), None)
    return found

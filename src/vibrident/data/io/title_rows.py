"""Read the rows of names and units above the columns of a text file, in either order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

from vibrident.data.io.plain_text import BLANKS
from vibrident.data.io.text_head import HeadLine, is_key
from vibrident.data.io.units import is_no_unit, is_row_counter, parse_unit
from vibrident.data.io.vocabulary import VOCABULARY

#: Names above a column that the rows do not have (LabVIEW).
COMMENTS = frozenset(VOCABULARY["comments"])
_NUMBER = re.compile(r"[+-]?\d*\.?\d+(?:[eE][+-]?\d+)?")
_BRACKETED = re.compile(r"\[.*\]|\(.*\)|<.*>")
_WITH_UNIT = re.compile(r"[^ ]+(?: (?:\[[^] ]*\]|\([^) ]*\)))?")
#: Of an abscissa.
TIME_NAMES = re.compile(
    r"(?:x|t|x[ _-]?(?:value|axis|achse)|time\w*|zeit|seconds?|source|f|freq\w*)\b", re.IGNORECASE
)


def columns_of(data: Sequence[list[str]], above: Sequence[list[str]], fields: int) -> int:
    """Return the number of columns: fields without those behind the last separators of the rows.

    These have neither values nor a name, but for a key of the head (Rigol) or "Comment" (LabVIEW).
    """
    columns = fields
    while columns > 1:
        last = columns - 1
        titles = [row[last] for row in above if len(row) > last]
        if any(len(row) > last and row[last] for row in data):
            break
        if not all(map(_is_no_title, titles)):
            break
        columns = last
    return columns


def keys_over_values(rows: dict[int, list[str]], columns: int) -> list[HeadLine]:
    """Return statements by keys beside the names, with their values in s below (Rigol)."""
    head_lines = []
    for (i, row), (_, below) in pairwise(rows.items()):
        head_lines += [
            HeadLine(i + 1, f"{key}: {value} s")
            for key, value in zip(row[columns:], below[columns:], strict=False)
            if is_key(key) and value
        ]
    return head_lines


def names_and_units(
    rows: Sequence[list[str]], delimiter: str, columns: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units of the columns, "" without, from the rows of cells above the data."""
    without = ("",) * columns
    above = [_fitting(row, delimiter, columns) for row in rows[-2:]]
    for units, names in (above[::-1], above) if len(above) > 1 else ():
        if units is not None and names is not None and _are_units(units, names):
            return names, units
    return (above[-1] if above else None) or without, without


def _fitting(row: list[str], delimiter: str, columns: int) -> tuple[str, ...] | None:
    """Return a row's cells above the columns; None if it is of another width."""
    if columns == 1 and delimiter == BLANKS:
        return (" ".join(row),)  # the name of a single column may contain blanks
    if delimiter == BLANKS and len(row) > columns:  # "a [g]" is one name
        row = _WITH_UNIT.findall(" ".join(row))
    fits = len(row) >= columns and all(map(_is_no_title, row[columns:]))
    return tuple(row[:columns]) if fits else None


def _is_no_title(cell: str) -> bool:
    """Tell whether a cell above no column belongs to none."""
    return (
        not cell or cell.lower() in COMMENTS or is_key(cell) or _NUMBER.fullmatch(cell) is not None
    )


def _are_units(row: Sequence[str], names: Sequence[str]) -> bool:
    """Tell whether a row beside the names has units: known ones, in brackets, or words for none."""
    recognised = unknown = 0
    for cell, name in zip(row, names, strict=True):
        if _BRACKETED.fullmatch(cell) or parse_unit(cell) is not None:
            recognised += 1
        elif is_row_counter(cell) or (cell and cell.lower() in name.lower()):
            unknown += 1
        elif not is_no_unit(cell):
            return False
    return recognised > unknown

"""Rows of values under headings made of their keys: records, points, plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from vibrident.present.numbers import NONE, plain
from vibrident.terminal.tables import literal, titled

if TYPE_CHECKING:
    from rich.table import Table


def inspection_table(rows: Sequence[Mapping[str, object]], title: str = "Calibration data") -> Table:
    """Rows of ``vibrident inspect`` as a table.

    Args:
        rows: column name to value; columns in the order in which they first appear, ``frequency_hz`` shown as
            ``frequency / Hz``; numbers to five digits, None as –, flags as yes and no, sequences joined by commas.
            What is the same in all of three or more rows is said once, below the table.
        title: heading of the table.
    """
    keys = list(dict.fromkeys(key for row in rows for key in row))
    table = titled(title, None)
    same = _same_everywhere(rows, keys)
    if same:
        parts = []
        for key in same:
            name, _, unit = _heading(key).partition(" / ")
            parts.append(f"{name} {_cell(rows[0][key])} {unit}".strip())
        table.caption = literal(f"All: {', '.join(parts)}")
    keys = [key for key in keys if key not in same]
    for key in keys:
        values = [row[key] for row in rows if row.get(key) is not None]
        numeric = bool(values) and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)
        longest = max((len(_cell(value)) for value in values), default=1)
        table.add_column(
            literal(_heading(key)),
            justify="right" if numeric else "left",
            overflow="fold",
            no_wrap=key == "parameter",
            min_width=longest if numeric else min(longest, 6),  # words and headings fold before numbers do
        )
    for row in rows:
        table.add_row(*(literal(_cell(row.get(key))) for key in keys))
    return table


def _same_everywhere(rows: Sequence[Mapping[str, object]], keys: Sequence[str]) -> list[str]:
    """Columns that say the same in each of several rows: they go to the caption, to leave room for the others."""
    if len(rows) < 3 or len(keys) < 6:
        return []
    return [key for key in keys[1:] if len({_cell(row.get(key)) for row in rows}) == 1 and rows[0].get(key) is not None]


def _heading(key: str) -> str:
    name, _, ending = key.rpartition("_")
    unit = {"hz": "Hz", "s": "s", "percent": "%", "deg": "°", "rad": "rad", "v": "V"}.get(ending)
    return f"{name.replace('_', ' ')} / {unit}" if name and unit else key.replace("_", " ")


def _cell(value: object) -> str:
    if value is None:
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return plain(value, 5)
    if isinstance(value, (list, tuple, set, frozenset)):
        return ", ".join(_cell(item) for item in value)
    return str(value)

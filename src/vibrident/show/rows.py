"""Make a table of rows of values by the names of their columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from vibrident.show.numbers import NONE, plain
from vibrident.show.views import Column, Table

_UNITS = {"hz": "Hz", "s": "s", "percent": "%", "deg": "°", "rad": "rad", "v": "V"}


def table_of(rows: Sequence[Mapping[str, object]], title: str = "Calibration data") -> Table:
    """Return rows of values under headings made of their keys.

    ``rows``: column name to value; columns in the order in which they first appear,
    ``frequency_hz`` shown as ``frequency / Hz``; numbers to five digits, None as –, flags as yes
    and no, sequences joined by commas. What is the same in all of three or more rows is said once,
    below the table; ``title``: heading of the table.
    """
    keys = list(dict.fromkeys(key for row in rows for key in row))
    same = _same_everywhere(rows, keys)
    named = ((_heading(key).partition(" / "), _cell(rows[0][key])) for key in same)
    constants = [f"{name} {cell} {unit}".strip() for (name, _, unit), cell in named]
    keys = [key for key in keys if key not in same]
    heads = tuple(
        Column(_heading(key), "number" if _numeric(rows, key) else "text") for key in keys
    )
    cells = tuple(tuple(_cell(row.get(key)) for key in keys) for row in rows)
    return Table(
        heads, cells, notes=(f"All: {', '.join(constants)}",) if constants else (), title=title
    )


def _numeric(rows: Sequence[Mapping[str, object]], key: str) -> bool:
    values = [row[key] for row in rows if row.get(key) is not None]
    return bool(values) and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in values
    )


def _same_everywhere(rows: Sequence[Mapping[str, object]], keys: Sequence[str]) -> list[str]:
    """Return the columns that say the same in each of several rows.

    They go to the caption, to leave room for the others.
    """
    if len(rows) < 3 or len(keys) < 6:
        return []
    return [
        key
        for key in keys[1:]
        if len({_cell(row.get(key)) for row in rows}) == 1 and rows[0].get(key) is not None
    ]


def _heading(key: str) -> str:
    name, _, ending = key.rpartition("_")
    unit = _UNITS.get(ending)
    return f"{name.replace('_', ' ')} / {unit}" if name and unit else key.replace("_", " ")


def _cell(value: object) -> str:
    if value is None:
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return plain(value, 5)
    if isinstance(value, list | tuple | set | frozenset):
        return ", ".join(_cell(item) for item in value)
    return str(value)

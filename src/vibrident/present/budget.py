"""The uncertainty budget as a table: what each source adds to the standard uncertainty of each parameter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vibrident.naming import Scale, parameter_name, pretty, scaled
from vibrident.present.numbers import NONE, plain, uncertainty
from vibrident.present.views import Column, Table, columns
from vibrident.result import Parameter, Result

_NOTE = (
    "A column of a parameter holds the standard uncertainties that the sources contribute, and u of the result below. "
    "u of a source is stated by its kind: gain, clock and mounting are relative."
)


def budget(result: Result) -> Table | None:
    """A row a source and a column a parameter; None where the settings hold no such budget."""
    rows = result.settings.get("uncertainty_budget")
    if not isinstance(rows, list | tuple) or not rows or not all(_is_row(row) for row in rows):
        return None
    names = [
        name for name in dict.fromkeys(n for row in rows for n in row["contributions"]) if name in result.parameters
    ]
    units = {name: _scale(result.parameters[name]) for name in names}
    body = [
        (
            str(row["source"]),
            str(row.get("type") or NONE),
            str(row.get("kind") or NONE),
            _stated(row),
            plain(row.get("degrees_of_freedom"), 4),
            *(_size(row["contributions"].get(name), units[name]) for name in names),
        )
        for row in rows
    ]
    together = (_size(result.parameters[name].standard_uncertainty, units[name]) for name in names)
    body.append(("u of the result", "", "", "", "", *together))
    heads = [Column(parameter_name(name).words, "number", units[name].printed) for name in names]
    heads = (*columns("source", "type", "kind"), *columns("u", "ν", kind="number"), *heads)
    return Table(heads, tuple(body), notes=(_NOTE,))


def _is_row(row: Any) -> bool:
    return isinstance(row, Mapping) and "source" in row and isinstance(row.get("contributions"), Mapping)


def _scale(parameter: Parameter) -> Scale:
    known = [abs(x) for x in (parameter.value, parameter.standard_uncertainty) if x is not None]
    return scaled(parameter.unit, max(known, default=0.0))


def _size(value: float | None, scale: Scale) -> str:
    return uncertainty(scale.times(value))


def _stated(row: Mapping[str, Any]) -> str:
    value, unit = row.get("standard_uncertainty"), str(row.get("unit") or "")
    return NONE if value is None else f"{plain(value, 4)} {pretty(unit) if unit != '1' else ''}".strip()

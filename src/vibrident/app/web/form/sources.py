"""Convert sources of uncertainty as certificates state them: u, U with its k, or by frequency.

The calibration file knows u, and a table over frequency; a form fills these in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from vibrident.app.web.form.description import ENTRIES
from vibrident.app.web.language import phrase
from vibrident.base.fields import Fields, GivenFields, NamedNumbers
from vibrident.data.io.keys import Key

_EDGE = 1e-9  # relative distance of two rows at the edge between bands, which rise so
_K = 2.0  # coverage factor that is usual
_WAYS = {
    "u": "u",
    "U": phrase("U with k"),
    "table": phrase("by frequency"),
}


#: Columns of a value by frequency.
BANDS = (
    Key("from_hz", None, "number", {}, None, "", phrase("From"), "Hz", in_form=("Hz", 1.0)),
    Key("to_hz", None, "number", {}, None, "", phrase("To"), "Hz", in_form=("Hz", 1.0)),
    Key("value", None, "number", {}, None, "", phrase("Standard uncertainty")),
)


#: Key → the ways of stating a source in which it holds; the others hold in all.
_WAYS_OF = {
    "standard_uncertainty": ("u",),
    "expanded_uncertainty": ("U",),
    "coverage_factor": ("U",),
    "table": ("table",),
    "from_hz": ("u", "U"),
    "to_hz": ("u", "U"),
}


def applies(key: Key, row: GivenFields) -> bool:
    """Return whether a key has a meaning beside the values of the others."""
    return key.applies(row) and row.get("stated_as") in _WAYS_OF.get(key.name, _WAYS)


def source_keys() -> list[Key]:
    """Return the keys of a source in a form: those of the file, and how its size is stated."""
    keys: list[Key] = []
    size = next(key for key in ENTRIES["uncertainty"] if key.name == "standard_uncertainty")
    for key in ENTRIES["uncertainty"]:
        if key is size:
            plain = {"default": _K, "in_form": ("", 1.0), "in_form_by": None}
            keys += [
                Key("stated_as", "u", "choice", _WAYS, None, "", phrase("Stated as")),
                size,
                replace(size, name="expanded_uncertainty", title="U"),
                replace(size, name="coverage_factor", title="k", **plain),
            ]
        elif key.name == "table":
            keys.append(replace(key, in_form_by=size.in_form_by))
        else:
            keys.append(key)
    return keys


def entry_in_form(entry: GivenFields) -> Fields:
    """Return an entry of the file as the form asks for it."""
    return {"stated_as": "table" if entry.get("table") else "u", **entry}


def entry_in_file(row: GivenFields) -> Fields:
    """Return a filled row as the file states it: u is U divided by k."""
    entry = {name: value for name, value in row.items() if name != "stated_as"}
    expanded = entry.pop("expanded_uncertainty", None)
    k = entry.pop("coverage_factor", _K)
    if expanded is not None:
        entry["standard_uncertainty"] = float(f"{expanded / k:.15g}") if k > 0.0 else -expanded
    return entry


def bands_of(table: Sequence[Sequence[float]]) -> list[NamedNumbers]:
    """Return the rows of a table as bands of one value, and the others as single frequencies."""
    bands: list[NamedNumbers] = []
    rows = [tuple(row) for row in table]
    while rows:
        frequency, value = rows.pop(0)
        band = {"from_hz": frequency, "value": value}
        if bands and frequency < bands[-1].get("to_hz", 0.0) * (1.0 + 2.0 * _EDGE):
            band["from_hz"] = bands[-1]["to_hz"]
        if rows and rows[0][1] == value:
            band["to_hz"] = rows.pop(0)[0]
        bands.append(band)
    return bands


def table_of(bands: Sequence[GivenFields]) -> list[list[Any]]:
    """Return the rows of a table that is constant over bands, and linear between them.

    A band without an upper end is a single frequency; a value that is missing is None.
    """
    table: list[list[Any]] = []
    for band in bands:
        low, high, value = (band.get(name) for name in ("from_hz", "to_hz", "value"))
        if table and low is not None and low == table[-1][0]:
            low *= 1.0 + _EDGE
        table.append([low, value])
        if high is not None:
            table.append([high, value])
    return table

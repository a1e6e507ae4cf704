"""Table of a store's calibrations as a file: Parquet or CSV."""

from __future__ import annotations

import csv
import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vibrident.base.escaping import csv_cell
from vibrident.base.extras import library
from vibrident.base.fields import GivenFields


def write(rows: Sequence[GivenFields], file: Path) -> None:
    """Write rows, each with the columns it has, to a file that ends in ``.parquet`` or ``.csv``.

    Raises:
        InputError: Parquet is asked for, and pyarrow is not installed.
    """
    names = list(dict.fromkeys(name for row in rows for name in row))
    if file.suffix.lower() == ".csv":
        with file.open("w", newline="", encoding="utf-8") as stream:
            table = csv.writer(stream)
            table.writerow(names)
            table.writerows([[_cell(row.get(name)) for name in names] for row in rows])
        return
    missing = "A table in Parquet needs pyarrow, which is not installed; in CSV it does not."
    arrow = library("pyarrow", "parquet", missing, str(file))
    parquet = library("pyarrow.parquet", "parquet", missing, str(file))
    columns = {
        name: arrow.array([row.get(name) for row in rows], type=_type(arrow, rows, name))
        for name in names
    }
    parquet.write_table(arrow.table(columns), file)


def _type(arrow: Any, rows: Sequence[GivenFields], name: str) -> Any:
    """Return the column's type from its values; numeric if there are none, as most columns are."""
    value = next((row[name] for row in rows if row.get(name) is not None), None)
    if isinstance(value, list):
        return arrow.list_(arrow.string())
    kinds = {bool: arrow.bool_, int: arrow.int64, str: arrow.string, datetime.date: arrow.date32}
    return kinds.get(type(value), arrow.float64)()


def _cell(value: Any) -> Any:
    if isinstance(value, list):
        return " ".join(str(item) for item in value)
    return csv_cell(value) if isinstance(value, str) else value

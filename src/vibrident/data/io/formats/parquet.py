"""Parquet files: columns of numbers or times, with what the file's metadata state.

The format itself knows no rate and no unit. Metadata of a column or of the file state them, those
of pandas included: attributes of the frame, such as {"units": {"a": "g"}, "fs": 51200}.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import (
    Channel,
    ColumnFile,
    StartTime,
    library,
    reading,
    real_numbers,
    require_room,
)
from vibrident.data.io.reader import Reader
from vibrident.data.io.stated import (
    Statement,
    clock_of,
    nearest_unit,
    start_of,
    statements,
)
from vibrident.data.records import FloatArray


class ParquetFile(ColumnFile):
    """A Parquet file. Only the columns that are needed are read; a missing value becomes NaN."""

    expected = "a Parquet file with columns of numbers"

    def __init__(self, path: Path) -> None:
        self._parquet = library("pyarrow.parquet", "parquet", path)
        types = library("pyarrow.types", "parquet", path)
        with reading(path, self.expected), self._parquet.ParquetFile(path) as file:
            schema = file.schema_arrow
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        number_types = (types.is_integer, types.is_floating, types.is_boolean)
        file_metadata = _metadata(schema.metadata)
        pandas = _mapping(file_metadata.pop("pandas", None))
        file_metadata |= _mapping(pandas.get("attributes"))
        pandas_columns = {
            column.get("field_name"): _mapping(column.get("metadata"))
            for column in map(_mapping, pandas.get("columns") or ())
        }
        for field in schema:
            name = field.name
            is_time = types.is_timestamp(field.type) or types.is_duration(field.type)
            if not is_time and not any(is_type(field.type) for is_type in number_types):
                refused[name] = f"of type {field.type}"
                continue
            metadata = pandas_columns.get(name, {}) | _metadata(field.metadata)
            levels = [statements(metadata), _column_statements(file_metadata, name)]
            clock = clock_of(levels, f"{path}, column {name!r}")
            unit = "" if is_time else nearest_unit(name, levels[0], levels[1])
            channels.append(Channel(name, name, clock, is_time, unit, start=start_of(levels)))
        super().__init__(path, channels, refused)

    def _first_date(self, position: int) -> StartTime | None:
        name = self._channels[position].handle
        with reading(self._path, self.expected), self._parquet.ParquetFile(self._path) as file:
            first = next(file.iter_batches(1, columns=[name])).column(0).to_numpy(False)[:1]
        if first.dtype.kind != "M" or np.isnat(first).any():
            return None
        return StartTime.on_date(first[0])

    def _read(self, handles: Sequence[str]) -> Iterator[FloatArray]:
        with self._parquet.ParquetFile(self._path) as file:
            require_room(self._path, _numbers(file.metadata, set(handles)))
            table = file.read(columns=[*dict.fromkeys(handles)])
        for name in handles:
            yield real_numbers(table.column(name).to_numpy())


def _numbers(metadata: Any, names: set[str]) -> int:
    """Return how many numbers these columns hold, by the footer: the larger of rows and bytes."""
    groups = [metadata.row_group(index) for index in range(metadata.num_row_groups)]
    chunks = [group.column(index) for group in groups for index in range(group.num_columns)]
    unpacked = sum(
        chunk.total_uncompressed_size for chunk in chunks if chunk.path_in_schema in names
    )
    return max(
        metadata.num_rows * len(names),
        sum(group.num_rows for group in groups) * len(names),
        unpacked // 8,
    )


def _metadata(metadata: Mapping[bytes, bytes] | None) -> dict[str, Any]:
    """Return metadata as text; JSON of an object as what it holds."""
    values: dict[str, Any] = {}
    for name, value in (metadata or {}).items():
        text: Any = value.decode("utf-8", "replace")
        if text.startswith("{"):
            with contextlib.suppress(ValueError, RecursionError):
                text = json.loads(text)
        values[name.decode("utf-8", "replace")] = text
    return values


def _mapping(value: Any) -> dict[str, Any]:
    """Return a mapping of metadata; an empty one for a value of another kind."""
    return value if isinstance(value, dict) else {}


def _column_statements(values: Mapping[str, Any], column: str) -> dict[str, Statement]:
    """Return what the file's metadata state of a column: for all, or by the column's name.

    Its name may be inside what is stated, {"unit": {"a": "g"}}, or around it, {"a": {"unit": "g"}}.
    """
    return statements(
        _mapping(values.get(column))
        | {
            name: value.get(column, "") if isinstance(value, dict) else value
            for name, value in values.items()
            if not isinstance(value, dict) or column in value
        }
    )


PARQUET = Reader(name="parquet", title="Parquet", endings=(".parquet", ".pq"), open=ParquetFile)

"""Parquet files: columns of numbers or times, with what the file's metadata state.

The format itself knows no rate and no unit. Metadata of a column or of the file state them, those
of pandas included: attributes of the frame, such as {"units": {"a": "g"}, "fs": 51200}.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping, Sequence
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

_EXPECTED = "a Parquet file with columns of numbers"


class ParquetFile(ColumnFile):
    """A Parquet file. Only the columns that are needed are read; a missing value becomes NaN."""

    def __init__(self, path: Path) -> None:
        self._parquet = library("pyarrow.parquet", "parquet", path)
        types = library("pyarrow.types", "parquet", path)
        with reading(path, _EXPECTED), self._parquet.ParquetFile(path) as file:
            schema = file.schema_arrow
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        of_file = _metadata(schema.metadata)
        pandas = of_file.pop("pandas", None)
        pandas = pandas if isinstance(pandas, dict) else {}
        if isinstance(attributes := pandas.get("attributes"), dict):
            of_file.update(attributes)
        of_columns = {
            column.get("field_name"): column.get("metadata")
            for column in pandas.get("columns") or ()
            if isinstance(column, dict)
        }
        for field in schema:
            timed = types.is_timestamp(field.type) or types.is_duration(field.type)
            if not timed and not any(
                is_kind(field.type)
                for is_kind in (types.is_integer, types.is_floating, types.is_boolean)
            ):
                refused[field.name] = f"of type {field.type}"
                continue
            metadata = of_columns.get(field.name)
            metadata = {
                **(metadata if isinstance(metadata, dict) else {}),
                **_metadata(field.metadata),
            }
            levels = [statements(metadata), _of_column(of_file, field.name)]
            clock = clock_of(levels, f"{path}, column {field.name!r}")
            unit = nearest_unit(field.name, levels[0], levels[1])
            unit = "" if timed else unit
            start = start_of(levels)
            channels.append(Channel(field.name, field.name, clock, timed, unit, start=start))
        super().__init__(path, channels, refused)

    def start(self, position: int) -> StartTime | None:
        """Return the time of a column's first sample, or of a column of dates its first date."""
        if not self.in_seconds(position):
            return super().start(position)
        name = self._channels[position].handle
        with reading(self._path, _EXPECTED), self._parquet.ParquetFile(self._path) as file:
            first = next(file.iter_batches(1, columns=[name])).column(0).to_numpy(False)[:1]
        if first.dtype.kind != "M" or np.isnat(first).any():
            return None
        return StartTime(int(first.astype("datetime64[ns]").astype(np.int64)[0]), epoch=True)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these columns; each has shape (samples,).

        Timestamps become seconds since the first.
        """
        names = self._handles(positions)
        with reading(self._path, _EXPECTED):
            with self._parquet.ParquetFile(self._path) as file:
                require_room(self._path, _numbers(file.metadata, set(names)))
                table = file.read(columns=[*dict.fromkeys(names)])
            return tuple(real_numbers(table.column(name).to_numpy()) for name in names)


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


def _of_column(values: Mapping[str, Any], column: str) -> dict[str, Statement]:
    """Return what the file's metadata state of a column: for all, or by the column's name."""
    return statements(
        {
            name: value.get(column, "") if isinstance(value, dict) else value
            for name, value in values.items()
            if not isinstance(value, dict) or column in value
        }
    )


PARQUET = Reader(name="parquet", title="Parquet", endings=(".parquet", ".pq"), open=ParquetFile)

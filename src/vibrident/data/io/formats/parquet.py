"""Parquet files: columns of numbers or times. The rate comes from a time column or from the file's metadata."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError
from vibrident.data.io.columns import (
    Channel,
    Clock,
    ColumnFile,
    library,
    reading,
    real_numbers,
    require_room,
)
from vibrident.data.io.reader import Reader
from vibrident.data.records import FloatArray

_EXPECTED = "a Parquet file with columns of numbers"
#: The format knows no sampling rate; a writer may state it as metadata of the file or of a column, under this key.
_RATE_KEY = b"sampling_rate_hz"


class ParquetFile(ColumnFile):
    """A Parquet file. Only the columns that are needed are read; a missing value becomes NaN."""

    def __init__(self, path: Path) -> None:
        self._parquet = library("pyarrow.parquet", "parquet", path)
        types = library("pyarrow.types", "parquet", path)
        with reading(path, _EXPECTED), self._parquet.ParquetFile(path) as file:
            schema = file.schema_arrow
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        of_the_file = (schema.metadata or {}).get(_RATE_KEY)
        for field in schema:
            timed = types.is_timestamp(field.type) or types.is_duration(field.type)
            if timed or any(
                of(field.type) for of in (types.is_integer, types.is_floating, types.is_boolean)
            ):
                rate = (field.metadata or {}).get(_RATE_KEY, of_the_file)
                clock = _clock(rate, f"{path}, column {field.name!r}")
                channels.append(Channel(field.name, field.name, clock, timed))
            else:
                refused[field.name] = f"of type {field.type}"
        super().__init__(path, channels, refused)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these columns; each has shape (samples,). Timestamps become seconds since the first."""
        names = [self._channels[position].handle for position in positions]
        with reading(self._path, _EXPECTED):
            with self._parquet.ParquetFile(self._path) as file:
                require_room(self._path, _numbers(file.metadata, set(names)))
                table = file.read(columns=[*dict.fromkeys(names)])
            return tuple(real_numbers(table.column(name).to_numpy()) for name in names)


def _numbers(metadata: Any, names: set[str]) -> int:
    """How many numbers these columns hold, by the footer: its rows, or the bytes of their pages if these are more."""
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


def _clock(text: bytes | None, where: str) -> Clock | None:
    if text is None:
        return None
    try:
        rate_hz = float(text)
    except ValueError:
        rate_hz = math.nan
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        raise InputError(
            "The sampling rate in the file's metadata cannot be used.",
            expected=f"{_RATE_KEY.decode()} to be a finite number above 0",
            found=repr(text.decode("utf-8", "replace")),
            where=where,
            remedy="correct the metadata, or write the file without it and give rate_hz",
        )
    return Clock(rate_hz)


PARQUET = Reader(name="parquet", title="Parquet", endings=(".parquet", ".pq"), open=ParquetFile)

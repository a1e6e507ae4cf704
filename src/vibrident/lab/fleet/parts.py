"""Rows on the disk, one file per batch, indexed by key; a later run finds them again."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.base import files
from vibrident.base.errors import InputError
from vibrident.base.extras import library
from vibrident.base.fields import Fields, GivenFields
from vibrident.data.records import BoolArray
from vibrident.lab.fleet.row import FAILED, IDENTIFIED, Row

#: Columns of a part besides those of parameters; units are JSON, limits are of failed
#: calibrations.
_TEXTS = ("key", "status", "message", "serial_number", "type", "model", "estimator", "units")
_NUMBERS = ("chi2_reduced", "seconds", "finished", "time_limit_s", "memory_limit_bytes")
_FLAGS = ("adequate", "passing")
_ABANDONED_FILE_AGE_S = (
    3600.0  # age from which an unfinished file belongs to a process that has ended
)
PACKED = np.dtype("S32")  # type of an array of keys


#: A row on the disk: its key, where it is, and what decides between rows of one key.
_ROW_DTYPE = np.dtype(
    [
        ("key", PACKED),
        ("part", "i4"),
        ("row", "i4"),
        ("seconds", "f4"),
        ("memory", "f4"),
        ("ended", "?"),
        ("is_final", "?"),
    ]
)


def arrow() -> Any:
    """Return the library of the table.

    Raises:
        InputError: it is not installed.
    """
    return library(
        "pyarrow",
        "fleet",
        "The table of a fleet needs pyarrow, which is not installed.",
        "vibrident fleet",
    )


def load_arrow() -> None:
    """Load pyarrow for a command: with a pool that returns memory, and without pandas.

    The first array that pyarrow makes loads pandas, in a quarter of a second and 30 MB, for nothing
    that is done here. It tries once; its ``to_pandas`` tries again.

    Raises:
        InputError: it is not installed.
    """
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    pa = arrow()
    sys.meta_path.insert(0, SimpleNamespace(find_spec=_no_pandas))  # type: ignore[arg-type]
    try:
        pa.array([0])
    finally:
        del sys.meta_path[0]


def _no_pandas(name: str, *_: object) -> None:
    if name == "pandas":
        raise ImportError(name)


@dataclass(frozen=True, eq=False)
class Index:
    """Place of each key's row; of several rows of a key, a finished one, else the latest."""

    keys: NDArray[np.bytes_]  # sorted, each once, as ``packed`` gives them; shape (keys,)
    part: NDArray[np.int32]  # number of the part in ``parts``; shape (keys,)
    row: NDArray[np.int32]  # number of the row in it; shape (keys,)
    is_final: BoolArray  # False if the row has to be computed again; shape (keys,)
    parts: list[str]  # names of the files
    parameters: list[tuple[str, ...]]  # that each part has columns for

    def positions_of(self, keys: NDArray[np.bytes_]) -> NDArray[np.intp]:
        """Return the positions of keys in the index, −1 for a key that is not in it."""
        if not self.keys.size:
            return np.full(keys.shape, -1)
        positions = np.minimum(np.searchsorted(self.keys, keys), self.keys.size - 1)
        return np.where(self.keys[positions] == keys, positions, -1)


def packed(keys: Sequence[str]) -> NDArray[np.bytes_]:
    """Pack keys, given as hexadecimal digits, into 32 bytes each."""
    return np.frombuffer(bytes.fromhex("".join(keys)), dtype=PACKED)


def digits(keys: NDArray[np.bytes_]) -> list[str]:
    """Return the hexadecimal digits of packed keys."""
    # NumPy leaves out zeros at the end
    return [key.ljust(32, b"\0").hex() for key in keys.tolist()]


def remove_left(folder: Path) -> None:
    """Remove unfinished files of processes that were killed."""
    for path in folder.glob(f".*{files.ENDING}"):
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > _ABANDONED_FILE_AGE_S:
                path.unlink()


def as_table(rows: Sequence[Row], time_limit_s: float, memory_limit_bytes: int | None) -> Any:
    """Return rows as a table of pyarrow, with the limits that applied to them."""
    pa = arrow()
    columns: Fields = {
        field: pa.array([text(row.get(field)) for row in rows], pa.string()) for field in _TEXTS
    }
    columns["units"] = pa.array([_units(row) for row in rows], pa.string())
    limits = {"time_limit_s": time_limit_s, "memory_limit_bytes": memory_limit_bytes}
    for field in _NUMBERS:
        columns[field] = pa.array([{**row, **limits}[field] for row in rows], pa.float64())
    for field in _FLAGS:
        columns[field] = pa.array([row[field] for row in rows], pa.bool_())
    columns["warnings"] = pa.array([row["warnings"] for row in rows], pa.list_(pa.string()))
    for parameter in dict.fromkeys(parameter for row in rows for parameter in row["parameters"]):
        pairs = [row["parameters"].get(parameter, (None, None)) for row in rows]
        columns[parameter] = pa.array([value[0] for value in pairs], pa.float64())
        columns[f"{parameter}_u"] = pa.array([value[1] for value in pairs], pa.float64())
    return pa.table(columns)


def write_part(
    folder: Path, rows: Sequence[Row], time_limit_s: float, memory_limit_bytes: int | None
) -> str:
    """Write rows into a part, and return its name.

    The name is a hash of the keys, so that the same rows never make two parts.
    """
    import pyarrow.parquet as pq

    name = _name([row["key"] for row in rows])
    table = as_table(rows, time_limit_s, memory_limit_bytes)
    with files.atomic_write(folder / name) as partial:
        pq.write_table(table, partial, compression="zstd", write_page_checksum=True)
    return name


def _name(keys: Sequence[str]) -> str:
    return hashlib.sha256("".join(sorted(keys)).encode()).hexdigest() + ".parquet"


def text(value: str | None) -> str | None:
    """Return text that can be written as UTF-8; a file's name may hold other bytes."""
    return None if value is None else value.encode("utf-8", "backslashreplace").decode("utf-8")


def _units(row: Row) -> str:
    return json.dumps(
        {name: entry[2] for name, entry in row["parameters"].items()}, separators=(",", ":")
    )


def parameters_of(columns: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the parameters that a part has columns for."""
    fixed = {*_TEXTS, *_NUMBERS, *_FLAGS, "warnings"}
    return tuple(name for name in columns if name not in fixed and f"{name}_u" in columns)


def index(
    folder: Path, results: Path | None, time_limit_s: float, memory_limit_bytes: int | None
) -> Index:
    """Index all rows on the disk; a part that cannot be read is ignored.

    A row has to be computed again if its whole result is wanted and missing, if the calibration
    failed within tighter limits than this run's, or if another attempt may have another outcome.
    ``results``: folder of the whole results; None: not wanted.
    """
    stored = None
    if results is not None:
        stored = {entry.name for entry in os.scandir(results) if entry.stat().st_size}
    names = []
    parameters = []
    blocks = [np.zeros(0, dtype=_ROW_DTYPE)]
    for path in sorted(folder.glob("*.parquet")):
        if (read := _read(path)) is None:
            continue
        columns, values = read
        block = _block(values, len(names), time_limit_s, memory_limit_bytes)
        if stored is not None:
            pairs = zip(values["key"], values["status"], strict=True)
            block["is_final"] &= [
                status != IDENTIFIED or f"{key}.json" in stored for key, status in pairs
            ]
        blocks.append(block)
        names.append(path.name)
        parameters.append(parameters_of(columns))
    entries = np.concatenate(blocks)
    del blocks
    entries = entries[_latest_of_each_key(entries)]
    key, part_number, row, is_final = (
        np.ascontiguousarray(entries[name]) for name in ("key", "part", "row", "is_final")
    )
    return Index(key, part_number, row, is_final, names, parameters)


def _block(
    values: GivenFields, part_number: int, time_limit_s: float, memory_limit_bytes: int | None
) -> NDArray[np.void]:
    """Return the places of a part's rows, and whether each is final under the limits of this run.

    Args:
        values: of the part's columns.
        part_number: number of the part.
        time_limit_s: of this run.
        memory_limit_bytes: of this run; None: no limit.
    """
    block = np.zeros(len(values["key"]), dtype=_ROW_DTYPE)
    failed = np.array(values["status"]) == FAILED
    passing = np.array(values["passing"])
    seconds = np.array(values["time_limit_s"], dtype=float)
    memory = np.array(
        [math.inf if limit is None else limit for limit in values["memory_limit_bytes"]],
        dtype=float,
    )
    memory_needed = math.inf if memory_limit_bytes is None else memory_limit_bytes
    ended = ~failed & ~passing
    failed_for_good = failed & ~passing & (time_limit_s <= seconds) & (memory_needed <= memory)
    block["key"] = packed(values["key"])
    block["part"] = part_number
    block["row"] = np.arange(block.size)
    block["ended"] = ended
    block["seconds"] = seconds
    block["memory"] = memory
    block["is_final"] = ended | failed_for_good
    return block


def _latest_of_each_key(entries: NDArray[np.void]) -> NDArray[np.intp]:
    """Return the index of each key's row that ended, else of that with the widest limits."""
    order = np.lexsort([entries[name] for name in ("memory", "seconds", "ended", "key")])
    keys = entries["key"][order]
    is_last = np.ones(entries.size, dtype=bool)
    is_last[:-1] = keys[1:] != keys[:-1]
    return order[is_last]


def _read(path: Path) -> tuple[list[str], dict[str, list[Any]]] | None:
    """Return the names of a part's columns, and the columns that an index needs.

    None for a file that is damaged, or no part.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            table = file.read()
        columns = ("key", "status", "passing", "time_limit_s", "memory_limit_bytes")
        values = {name: table[name].to_pylist() for name in columns}
        return (table.column_names, values) if path.name == _name(values["key"]) else None
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError):
        return None


def unwritable(error: OSError, folder: str) -> InputError:
    """Return the error of a folder that cannot be written, by a run that can be continued."""
    remedy = (
        "free disk space or correct the permissions (remote workers need the folder under the "
        "same name), then run the same command again: it continues where it stopped"
    )
    return files.unwritable(error, folder, remedy)

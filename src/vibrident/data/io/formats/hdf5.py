"""HDF5 files: one-dimensional datasets, and the columns of two-dimensional ones.

HDF5 itself follows links into other files, loads filters as plug-ins by their number, and gives a dataset of any length
from a fill value. A file read here must hold its numbers itself, within the limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import (
    MOST_COLUMNS,
    Channel,
    ColumnFile,
    reading,
    require_few,
    require_room,
)
from vibrident.data.io.reader import Reader
from vibrident.data.records import FloatArray

_EXPECTED = "an HDF5 file with datasets of real numbers"
#: Filters that come with the library: deflate, shuffle, Fletcher-32, szip, n-bit, scale-offset; LZF comes with h5py.
_FILTERS = frozenset({1, 2, 3, 4, 5, 6, 32000})


@dataclass(frozen=True)
class ArrayColumn:
    """One column of an array in a file."""

    array: str  # path of the dataset, or name of the variable
    column: int | None = (
        None  # column of a two-dimensional array, from 0; None for a one-dimensional one
    )
    transposed: bool = False  # True where the samples run along the second axis

    @property
    def name(self) -> str:
        """The name that a calibration file uses: "array", or "array:2" for column 2."""
        return self.array if self.column is None else f"{self.array}:{self.column + 1}"

    def of(self, array: Any) -> Any:
        """Take this column from the array; nothing else of an HDF5 dataset is read."""
        if self.column is None:
            return array[...]
        return array[self.column, :] if self.transposed else array[:, self.column]


def columns_of(name: str, shape: tuple[int, ...]) -> tuple[ArrayColumn, ...]:
    """Return the columns of an array: samples run along the longer axis.

    Scalars, arrays of three axes and very wide ones give none.
    """
    long_axes = [length for length in shape if length != 1]
    if (
        len(shape) > 2
        or len(long_axes) == 0
        or min(shape) < 1
        or (len(long_axes) == 2 and min(shape) > MOST_COLUMNS)
    ):
        return ()
    if len(long_axes) == 1:
        return (ArrayColumn(name),)
    rows, columns = long_axes
    return tuple(ArrayColumn(name, column, columns > rows) for column in range(min(shape)))


class ArrayFile(ColumnFile):
    """A file of named arrays; subclasses read them."""

    names_are_paths = True
    word = "array"

    def __init__(self, path: Path, columns: Sequence[ArrayColumn], refused: dict[str, str]) -> None:
        """Take the usable columns, and the refused arrays: name → reason."""
        super().__init__(path, [Channel(column.name, column) for column in columns], refused)

    @property
    def numbered(self) -> tuple[int, ...]:
        """The columns of the only two-dimensional array, or of the only array."""
        columns: list[ArrayColumn] = [channel.handle for channel in self._channels]
        if len({column.array for column in columns if column.column is not None}) == 1:
            return tuple(i for i, column in enumerate(columns) if column.column is not None)
        return (0,) if len(columns) == 1 else ()

    def _plain_name(self, name: str) -> str:
        return name.strip().strip("/")


class Hdf5File(ArrayFile):
    """An HDF5 file. Only the datasets that are needed are read."""

    def __init__(self, path: Path) -> None:
        import h5py

        columns: list[ArrayColumn] = []
        refused: dict[str, str] = {}

        def visit(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset) or name.startswith(
                "#"
            ):  # MATLAB keeps its objects in #refs#
                return
            reason = _reason_against(item)
            usable = () if reason else columns_of(name, item.shape)
            columns.extend(usable)
            if not usable:
                refused[name] = reason or f"of shape {item.shape}"
            require_few(path, [*columns, *refused], "datasets")

        with reading(path, _EXPECTED), h5py.File(path, "r") as file:
            file.visititems(visit)
        self._arrays: dict[str, Any] = {}  # datasets that were looked up
        self._roomy = 0  # most values of a block for which there was room
        super().__init__(path, columns, refused)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these columns; each has shape (samples,)."""
        import h5py

        with reading(self._path, _EXPECTED), h5py.File(self._path, "r") as file:
            columns = [self._channels[position].handle for position in positions]
            require_room(self._path, *_cost([file[column.array] for column in columns]))
            return tuple(
                np.asarray(c.of(file[c.array]), dtype=np.float64).reshape(-1) for c in columns
            )

    def length(self, position: int) -> int:
        """Number of samples of a column; nothing is read."""
        return int(max(self._file[self._channels[position].handle.array].shape))

    def block(self, positions: Sequence[int], start: int, stop: int) -> FloatArray:
        """Samples of columns from ``start`` up to ``stop``; nothing else is read. See ColumnFile.

        Integers of up to 16 bits become float32, which holds them exactly.
        """
        columns: list[ArrayColumn] = [self._channels[position].handle for position in positions]
        with reading(self._path, _EXPECTED):
            if len(columns) * (stop - start) > self._roomy:
                require_room(self._path, len(columns) * (stop - start))
                self._roomy = len(columns) * (stop - start)
            part = {
                name: _slice(self._array(name), start, stop)
                for name in {column.array for column in columns}
            }
            exact = all(
                values.dtype.kind in "iu" and values.dtype.itemsize <= 2 for values in part.values()
            )
            found: Any = np.empty((len(columns), stop - start), np.float32 if exact else np.float64)
            for row, column in zip(found, columns, strict=True):
                row[:] = ArrayColumn("", column.column).of(part[column.array]).reshape(-1)
            return found

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            self._arrays[name] = self._file[name]
        return self._arrays[name]

    @cached_property
    def _file(self) -> Any:
        """The file, kept open from the first block on."""
        import h5py

        with reading(self._path, _EXPECTED):
            return h5py.File(self._path, "r")


def _slice(dataset: Any, start: int, stop: int) -> Any:
    """Rows of samples along the long axis, samples first."""
    if dataset.ndim == 1:
        return dataset[start:stop]
    return (
        dataset[:, start:stop].T if dataset.shape[1] > dataset.shape[0] else dataset[start:stop, :]
    )


def _cost(datasets: Sequence[Any]) -> tuple[int, int]:
    """Number and size of the values read for a column of each of these datasets; chunks are read whole."""
    chunk = max((math.prod(dataset.chunks) for dataset in datasets if dataset.chunks), default=0)
    numbers = sum(max(dataset.shape) for dataset in datasets)
    return max(numbers, chunk), max(dataset.dtype.itemsize for dataset in datasets)


def _kept_elsewhere(dataset: Any) -> str:
    """Return why a dataset's numbers are outside the file or need a plug-in; "" if neither."""
    if dataset.external:
        return f"stored in another file, {str(dataset.external[0][0])!r}"
    if dataset.is_virtual:
        return "assembled from other datasets or files (a virtual dataset)"
    steps = dataset.id.get_create_plist()
    for step in range(steps.get_nfilters()):
        number, _, _, name = steps.get_filter(step)
        if number not in _FILTERS:
            return f"compressed with filter {number} ({name.decode('ascii', 'replace')}), which is a plug-in"
    return ""


def _reason_against(dataset: Any) -> str:
    """Return why a dataset cannot be a column; "" if it can."""
    matlab = dataset.attrs.get("MATLAB_class", b"")
    kind = matlab.decode("ascii", "replace") if isinstance(matlab, bytes) else str(matlab)
    if (
        kind in {"cell", "char", "function_handle", "string"}
        or "MATLAB_object_decode" in dataset.attrs
    ):
        return f"a MATLAB {kind} and not numbers"
    if "MATLAB_empty" in dataset.attrs or dataset.shape is None:
        return "empty"
    if dataset.dtype.kind in "iufb":
        return _kept_elsewhere(dataset)
    words = {
        "c": "complex",
        "O": "text or references",
        "S": "text",
        "V": "compound (a table of mixed fields)",
    }
    return f"{words.get(dataset.dtype.kind, str(dataset.dtype))} and not real numbers"


HDF5 = Reader(name="hdf5", title="HDF5", endings=(".h5", ".hdf5", ".hdf"), open=Hdf5File)

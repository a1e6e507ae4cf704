"""HDF5 and netCDF 4 files: datasets of one and two axes, with what their attributes state.

HDF5 itself follows links into other files, loads filters as plug-ins by their number, and gives a
dataset of any length from a fill value. A file read here must hold its numbers itself, within the
limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.arrays import ArrayColumn, ArrayFile, channels_of, columns_of
from vibrident.data.io.columns import (
    Channel,
    Positions,
    StartTime,
    reading,
    require_few,
    require_room,
)
from vibrident.data.io.hdf5_attributes import (
    axes_of,
    external_reason,
    levels_of,
    packing_of,
    text_attribute,
)
from vibrident.data.io.header_units import SourceColumn, is_time
from vibrident.data.io.reader import Reader
from vibrident.data.io.stated import Level, Levels, is_frequency, seconds_since, unit_of
from vibrident.data.io.units import factor_between
from vibrident.data.records import FloatArray

_PIECE_NUMBERS = 1 << 20  # numbers that are read at once
#: netCDF's name of a dimension that has no coordinates; its numbers mean nothing.
_NO_COORDINATES = "This is a netCDF dimension but not a netCDF variable"


class Hdf5File(ArrayFile):
    """An HDF5 file. Only the datasets that are needed are read."""

    expected = "an HDF5 file with datasets of real numbers"
    separator = "/"  # of the groups in a name

    def __init__(self, path: Path) -> None:
        import h5py

        columns: dict[str, tuple[ArrayColumn, ...]] = {}  # by array
        refused: dict[str, str] = {}

        def visit(array: str, item: Any) -> None:
            # MATLAB keeps its objects in #refs#
            if not isinstance(item, h5py.Dataset) or array.startswith("#"):
                return
            name = array.replace("/", self.separator)
            reason = _reason_against(item)
            usable = () if reason else columns_of(array, name, item.shape, item.dtype)
            if usable:
                columns[array] = usable
            else:
                refused[name] = reason or _no_columns(item)
            require_few(path, [*columns, *refused], "datasets")

        with reading(path, self.expected), h5py.File(path, "r") as file:
            file.visititems(visit)
            self._packing = {
                array: packing
                for array in columns
                if (packing := packing_of(file[array], f"{path}, array {array!r}"))
            }
            self._axes = axes_of(file, [*columns])
            groups: dict[str, Level] = {}
            levels = {array: levels_of(file, array, groups) for array in columns}
        self._since: dict[str, tuple[float, StartTime]] = {}  # of arrays of times since a date
        self._roomy = 0  # most values of a block for which there was room
        channels = [
            channel
            for array, usable in columns.items()
            for channel in self._described(array, usable, levels, path)
        ]
        super().__init__(path, channels, refused)

    def _described(
        self,
        array: str,
        columns: Sequence[ArrayColumn],
        levels: Mapping[str, Levels],
        path: Path,
    ) -> Iterator[Channel]:
        """Yield the channels of one array; over frequency, its axis is one of them."""
        axis = self._axes.get(array, "")
        axis_unit = unit_of(levels[axis][0]) if axis else ""
        over_frequency = is_frequency(axis.rsplit("/", 1)[-1], axis_unit)
        if over_frequency:
            name = f"{array.replace('/', self.separator)}.frequency"
            yield Channel(name, ArrayColumn(axis, name), unit=axis_unit, over_frequency=True)
        for channel in channels_of(columns, levels[array], str(path)):
            if over_frequency:
                yield replace(channel, clock=None, over_frequency=True)
            elif since := seconds_since(channel.unit):
                self._since[array] = since
                yield replace(channel, unit="", in_seconds=True)
            else:
                yield channel

    def stamps(self, position: int) -> FloatArray | None:
        """Return the times of a column's samples by the axis attached to it, in s; None if none."""
        axis = self._time_axis(position)
        return None if axis is None else self._seconds(axis)

    def start(self, position: int) -> StartTime | None:
        """Return the time of a column's first sample: of times since a date, the first one."""
        import h5py

        column: ArrayColumn = self._channels[position].handle
        if column.array not in self._since:
            axis = self._time_axis(position)
            if axis is None:
                return super().start(position)
            return self.start(axis) if self.in_seconds(axis) else None
        seconds, zero = self._since[column.array]
        unit_ns = round(seconds * 1e9)
        with reading(self._path, self.expected), h5py.File(self._path, "r") as file:
            first = _first(file[column.array], column)
        ns = int(first) * unit_ns if isinstance(first, np.integer) else round(first * unit_ns)
        return StartTime(zero.ns + ns, epoch=True)

    def _read(self, handles: Sequence[ArrayColumn]) -> tuple[FloatArray, ...]:
        import h5py

        with h5py.File(self._path, "r") as file:
            datasets: list[Any] = [file[column.array] for column in handles]
            require_room(self._path, *_cost(datasets))
            values = tuple(np.empty(max(d.shape), dtype=np.float64) for d in datasets)
            self._read_into(file, handles, values, 0, max(target.size for target in values))
            return values

    def length(self, position: int) -> int:
        """Return the number of samples of a column; nothing is read."""
        return int(max(self._datasets[self._channels[position].handle.array].shape))

    def block(self, positions: Positions, start: int, stop: int) -> FloatArray:
        """Return samples of columns from ``start`` up to ``stop``; nothing else is read.

        See ColumnFile. Integers of up to 16 bits become float32, which holds them exactly.
        """
        columns: list[ArrayColumn] = [self._channels[p].handle for p in positions]
        with reading(self._path, self.expected):
            if len(columns) * (stop - start) > self._roomy:
                require_room(self._path, len(columns) * (stop - start))
                self._roomy = len(columns) * (stop - start)
            exact = all(self._is_exact_in_single_precision(column.array) for column in columns)
            block: Any = np.empty((len(columns), stop - start), np.float32 if exact else np.float64)
            self._read_into(self._datasets, columns, block, start, stop)
            return block

    def reads_parts(self, position: int) -> bool:
        """Tell whether parts are read; the clock of a column with a time axis needs all of that."""
        return self._time_axis(position) is None

    @cached_property
    def _datasets(self) -> _Datasets:
        """Return the datasets of the file, kept open from the first block on."""
        import h5py

        with reading(self._path, self.expected):
            return _Datasets(h5py.File(self._path, "r"))

    def _time_axis(self, position: int) -> int | None:
        """Return the position of the time axis that is attached to a column; None if none is."""
        axis = self._axes.get(self._channels[position].handle.array)
        if axis is None or self._channels[position].over_frequency:
            return None
        name = axis.replace("/", self.separator)
        clock = self.names.index(name) if name in self.names else None
        if clock is None or not (
            self.in_seconds(clock)
            or is_time(axis.rsplit("/", 1)[-1])
            or factor_between(self.stated_unit(clock), "s") is not None
        ):
            return None
        return clock

    def _seconds(self, axis: int) -> FloatArray:
        (times,) = self.load([axis])
        self.require_finite(axis, times, 0, "correct the axis, or give rate_hz")
        return times * (SourceColumn(self, axis, "time_column").seconds or 1.0)

    def _is_exact_in_single_precision(self, array: str) -> bool:
        dtype = self._datasets[array].dtype
        is_small = dtype.kind in "iu" and dtype.itemsize <= 2
        return is_small and array not in self._packing and array not in self._since

    def _read_into(
        self,
        datasets: Any,
        columns: Sequence[ArrayColumn],
        targets: Sequence[FloatArray],
        start: int,
        stop: int,
    ) -> None:
        """Read samples of columns into ``targets``, a piece at a time."""
        for array in {column.array for column in columns}:
            dataset = datasets[array]
            last = min(stop, max(dataset.shape))
            pairs = zip(columns, targets, strict=True)
            loaded = [(column, target) for column, target in pairs if column.array == array]
            zeros = [_first(dataset, column) if array in self._since else 0 for column, _ in loaded]
            for begin in range(start, last, _piece(dataset)):
                end = min(begin + _piece(dataset), last)
                rows = _rows(dataset, begin, end)
                for (column, target), zero in zip(loaded, zeros, strict=True):
                    values = target[begin - start : end - start]
                    # subtracted as stored, to keep the digits
                    values[:] = column.values_in(rows) - zero if zero else column.values_in(rows)
                    if array in self._since:
                        values *= self._since[array][0]
                    elif array in self._packing:
                        self._packing[array].unpack(values)


class _Datasets(dict[str, Any]):
    """Datasets of an open file by path: HDF5 takes as long to look one up as to read a block."""

    def __init__(self, file: Any) -> None:
        super().__init__()
        self._file = file

    def __missing__(self, path: str) -> Any:
        dataset = self[path] = self._file[path]
        return dataset


def _first(dataset: Any, column: ArrayColumn) -> Any:
    """Return the first number of a column as it is stored."""
    return column.values_in(_rows(dataset, 0, 1))[0]


def _rows(dataset: Any, start: int, stop: int) -> Any:
    """Return samples of a dataset, its samples along the first axis."""
    if dataset.ndim == 1:
        return dataset[start:stop]
    if dataset.shape[1] > dataset.shape[0]:
        return dataset[:, start:stop].T
    return dataset[start:stop, :]


def _piece(dataset: Any) -> int:
    """Return how many samples are read at once: whole chunks, which would be unpacked again."""
    samples = max(dataset.shape)
    chunk = max(dataset.chunks) if dataset.chunks else 1
    rows = max(_PIECE_NUMBERS * samples // math.prod(dataset.shape), 1)
    return -(-rows // chunk) * chunk


def _cost(datasets: Sequence[Any]) -> tuple[int, int]:
    """Return number and size of the values read for a column of each of these datasets.

    Chunks are read whole.
    """
    chunk = max((math.prod(dataset.chunks) for dataset in datasets if dataset.chunks), default=0)
    numbers = sum(max(dataset.shape) for dataset in datasets)
    return max(numbers, chunk), max(dataset.dtype.itemsize for dataset in datasets)


def _reason_against(dataset: Any) -> str:
    """Return why a dataset cannot be a column; "" if it can."""
    kind = text_attribute(dataset, "MATLAB_class")
    if (
        kind in {"cell", "char", "function_handle", "string"}
        or "MATLAB_object_decode" in dataset.attrs
    ):
        return f"a MATLAB {kind} and not numbers"
    if "MATLAB_empty" in dataset.attrs or dataset.shape is None:
        return "empty"
    if text_attribute(dataset, "NAME").startswith(_NO_COORDINATES):
        return "a dimension without coordinates"
    if dataset.dtype.kind in "iufbcV":
        return external_reason(dataset)
    words = {"O": "text or references", "S": "text"}
    return f"{words.get(dataset.dtype.kind, str(dataset.dtype))} and not real numbers"


def _no_columns(dataset: Any) -> str:
    fields = f", compound of {', '.join(dataset.dtype.names)}" if dataset.dtype.names else ""
    return f"of shape {dataset.shape}{fields}"


HDF5 = Reader(
    name="hdf5", title="HDF5, netCDF 4", endings=(".h5", ".hdf5", ".hdf", ".nc"), open=Hdf5File
)

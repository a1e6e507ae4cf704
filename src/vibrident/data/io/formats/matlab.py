"""MATLAB files: up to version 7.2 through SciPy, 7.3 (which is HDF5) through h5py.

Numeric arrays, and those of structures as "struct.field". Cells and objects are refused by name.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io import mat5
from vibrident.data.io.arrays import ArrayColumn, ArrayFile, channels_of, columns_of, samples_first
from vibrident.data.io.columns import (
    Channel,
    ColumnFile,
    reading,
    require_few,
    require_room,
)
from vibrident.data.io.formats.hdf5 import Hdf5File
from vibrident.data.io.reader import Reader
from vibrident.data.io.stated import Levels, meaning_of, statements
from vibrident.data.records import FloatArray


def open_matlab_file(path: Path) -> ColumnFile:
    """Open a MATLAB file of any version.

    InputError: the file is not a MATLAB file, or holds no plain numeric array.
    """
    import h5py

    return Matlab73File(path) if os.path.isfile(path) and h5py.is_hdf5(path) else MatlabFile(path)


class Matlab73File(Hdf5File):
    """A MATLAB file of version 7.3; a field of a structure has the name "struct.field"."""

    separator = "."


class MatlabFile(ArrayFile):
    """A MATLAB file up to version 7.2."""

    expected = "a MATLAB file with numeric arrays"

    def __init__(self, path: Path) -> None:
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        self._arrays: dict[str, mat5.Numbers | np.ndarray] = {}
        with reading(path, self.expected):
            for name, value, levels in _leaves(_variables(path)):
                usable = ()
                if isinstance(value, mat5.Numbers | np.ndarray):
                    is_complex = isinstance(value, mat5.Numbers) and value.is_complex
                    dtype = np.dtype(complex if is_complex else float)
                    usable = columns_of(name, name, value.shape, dtype)
                    self._arrays[name] = value
                if not usable:
                    refused[name] = _reason_against(value)
                channels += channels_of(usable, [{}, *levels], str(path))
                require_few(path, [*channels, *refused], "arrays")
        super().__init__(path, channels, refused)

    def _read(self, handles: Sequence[ArrayColumn]) -> Iterator[FloatArray]:
        values = {column.array: self._arrays[column.array] for column in handles}
        require_room(self._path, sum(math.prod(value.shape) for value in values.values()))
        arrays = {name: samples_first(_array(value)) for name, value in values.items()}
        for column in handles:
            yield np.array(column.values_in(arrays[column.array]), dtype=np.float64)


def _variables(path: Path) -> dict[str, Any]:
    """Return name → variable of a file of any version but 7.3."""
    import scipy.io

    with path.open("rb") as stream:
        if 0 not in stream.read(4):  # version 5 or later begins with a text
            return mat5.read_variables(path)
    contents = scipy.io.whosmat(path, appendmat=False)
    require_room(path, sum(math.prod(shape) for _, shape, _ in contents))
    return scipy.io.loadmat(path, appendmat=False, variable_names=[name for name, *_ in contents])


def _array(value: mat5.Numbers | np.ndarray) -> np.ndarray:
    return value.array() if isinstance(value, mat5.Numbers) else value


def _leaves(
    tree: Mapping[str, Any], prefix: str = "", outer: Levels = ()
) -> Iterator[tuple[str, Any, Levels]]:
    """Yield name, value and the statements about it, nearest first, of all but structures."""
    values: dict[str, Any] = {}
    for path, value in _remarks(tree):
        for name in (path, path.rpartition(" ")[2]):
            if meaning_of(name)[0] and (stated := _statement_value(value)) is not None:
                values.setdefault(name, stated)
    levels = [statements(values), *outer]
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{name}.", levels)
        elif not name.startswith("__"):  # what SciPy says of the file
            yield f"{prefix}{name}", value, levels


def _remarks(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield paths and values of a structure, and of those in it that hold no column."""
    yield from ((f"{prefix}{name}", value) for name, value in tree.items())
    for name, value in tree.items():
        if isinstance(value, dict) and not _holds_column(value):
            yield from _remarks(value, f"{prefix}{name} ")


def _holds_column(value: Any) -> bool:
    if isinstance(value, dict):
        return any(map(_holds_column, value.values()))
    return isinstance(value, mat5.Numbers | np.ndarray) and math.prod(value.shape) > 1


def _statement_value(value: Any) -> Any:
    """Return the number or the text that a variable holds; None for a column."""
    if isinstance(value, mat5.Numbers | np.ndarray):
        return _array(value) if math.prod(value.shape) == 1 else None
    return value if isinstance(value, str | list) else None


def _reason_against(value: Any) -> str:
    """Return why a variable or a field is no column."""
    if isinstance(value, mat5.Numbers | np.ndarray):
        return f"of shape {value.shape}"
    kinds = {str: "char", list: "cell of texts"}
    kind = value.kind if isinstance(value, mat5.UnsupportedVariable) else kinds[type(value)]
    return f"a MATLAB {kind} and not a numeric array"


MATLAB = Reader(
    name="matlab", title="MATLAB, every version", endings=(".mat",), open=open_matlab_file
)

"""MATLAB files: up to version 7.2 through SciPy, 7.3 (which is HDF5) through h5py. Only plain numeric arrays."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vibrident.data.io.columns import ColumnFile, reading, require_room
from vibrident.data.io.formats.hdf5 import ArrayColumn, ArrayFile, Hdf5File, columns_of
from vibrident.data.io.reader import Reader
from vibrident.data.records import FloatArray

_EXPECTED = "a MATLAB file with numeric arrays"
_NUMERIC = frozenset(
    {
        "double",
        "single",
        "logical",
        *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
    }
)


def open_matlab_file(path: Path) -> ColumnFile:
    """Open a MATLAB file of any version. InputError: the file is not a MATLAB file, or holds no plain numeric array."""
    import h5py

    return Hdf5File(path) if os.path.isfile(path) and h5py.is_hdf5(path) else MatlabFile(path)


class MatlabFile(ArrayFile):
    """A MATLAB file up to version 7.2. Cells, structures and objects are refused by name, never unpacked."""

    def __init__(self, path: Path) -> None:
        import scipy.io

        with reading(path, _EXPECTED):
            variables = scipy.io.whosmat(path, appendmat=False)
        columns: list[ArrayColumn] = []
        refused: dict[str, str] = {}
        for name, shape, kind in variables:
            usable = columns_of(name, shape) if kind in _NUMERIC else ()
            columns.extend(usable)
            if not usable:
                refused[name] = f"of shape {shape}" if kind in _NUMERIC else _reason_against(kind)
        self._numbers = {name: math.prod(shape) for name, shape, _ in variables}
        super().__init__(path, columns, refused)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these columns; each has shape (samples,)."""
        import scipy.io

        columns: list[ArrayColumn] = [self._channels[position].handle for position in positions]
        with reading(self._path, _EXPECTED):
            require_room(
                self._path,
                sum(self._numbers[name] for name in {column.array for column in columns}),
            )
            arrays = scipy.io.loadmat(
                self._path, appendmat=False, variable_names=[c.array for c in columns]
            )
            complex_names = [c.name for c in columns if np.iscomplexobj(arrays[c.array])]
            if complex_names:
                raise ValueError(f"{complex_names[0]!r} is complex and not real")
            return tuple(
                np.asarray(c.of(arrays[c.array]), dtype=np.float64).reshape(-1) for c in columns
            )


def _reason_against(kind: str) -> str:
    way = (
        '; in MATLAB, save("file.mat", "-struct", "name") stores its fields as arrays'
        if kind == "struct"
        else ""
    )
    return f"a MATLAB {kind} and not a numeric array{way}"


MATLAB = Reader(
    name="matlab", title="MATLAB, every version", endings=(".mat",), open=open_matlab_file
)

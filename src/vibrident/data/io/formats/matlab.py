"""MATLAB files: up to version 7.2 through SciPy, 7.3 (which is HDF5) through h5py.

Numeric arrays, and those of structures as "struct.field". Cells and objects are refused by name.
"""

from __future__ import annotations

import math
import os
import zlib
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.arrays import ArrayColumn, ArrayFile, channels_of, columns_of, samples_first
from vibrident.data.io.columns import (
    Channel,
    ColumnFile,
    Start,
    memory_for,
    reading,
    require_few,
    require_room,
)
from vibrident.data.io.formats.hdf5 import Hdf5File
from vibrident.data.io.reader import Reader
from vibrident.data.io.stated import (
    Statement,
    meaning_of,
    start_of,
    statements,
)
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
_MAX_STATED_ITEMS = 10_000  # letters of a text that states something
# The format's numbers, version 5: a compressed element; the flag of complex numbers; of its header.
_COMPRESSED, _COMPLEX, _HEADER_BYTES = 15, 0x0800, 128
_PIECE_BYTES = 1 << 20


def open_matlab_file(path: Path) -> ColumnFile:
    """Open a MATLAB file of any version.

    InputError: the file is not a MATLAB file, or holds no plain numeric array.
    """
    import h5py

    return Matlab73File(path) if os.path.isfile(path) and h5py.is_hdf5(path) else MatlabFile(path)


class Matlab73File(Hdf5File):
    """A MATLAB file of version 7.3; a field of a structure has the name "struct.field"."""

    separator = "."


@dataclass(frozen=True)
class _Element:
    """A variable in a file of version 5."""

    name: str
    is_complex: bool
    begin: int  # place in the file, bytes
    size: int  # bytes
    is_compressed: bool


class MatlabFile(ArrayFile):
    """A MATLAB file up to version 7.2. Structures are loaded to see what they hold."""

    def __init__(self, path: Path) -> None:
        import scipy.io

        channels: list[Channel] = []
        refused: dict[str, str] = {}
        starts: dict[str, Start] = {}
        self._numbers: dict[str, int] = {}
        with reading(path, _EXPECTED):
            variables = scipy.io.whosmat(path, appendmat=False)
            tree = _outline(path, variables)
            for name, array, levels in _leaves(tree):
                kind = next((kind for other, _, kind in variables if other == name), "")
                usable = ()
                if isinstance(array, np.ndarray) and (not kind or kind in _NUMERIC):
                    usable = columns_of(name, name, array.shape, array.dtype)
                    self._numbers[name] = array.size
                if not usable:
                    refused[name] = _reason_against(array, kind)
                elif start := start_of(levels):
                    starts[name] = start
                channels += channels_of(usable, [{}, *levels], str(path))
                require_few(path, [*channels, *refused], "arrays")
        super().__init__(path, channels, refused, starts)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these columns; each has shape (samples,)."""
        columns: list[ArrayColumn] = [self._channels[position].handle for position in positions]
        paths = {column.array: column.array.split(".") for column in columns}
        with reading(self._path, _EXPECTED):
            require_room(self._path, sum(self._numbers[name] for name in paths))
            tree = _load(self._path, {names[0] for names in paths.values()})
            values = []
            for column in columns:
                array = samples_first(reduce(getitem, paths[column.array], tree))
                values.append(np.array(column.of(array), dtype=np.float64))
            return tuple(values)


def _outline(path: Path, variables: Sequence[tuple[str, tuple[int, ...], str]]) -> dict[str, Any]:
    """Return name → variable; large arrays by shape and type only, which take no memory."""
    complex_names = {element.name for element in _elements(path) if element.is_complex}
    loaded = {
        name
        for name, shape, kind in variables
        if kind == "struct" or (meaning_of(name)[0] and math.prod(shape) <= _MAX_STATED_ITEMS)
    }
    limit = memory_for(path.stat().st_size)
    require_room(path, _unpacked_bytes(path, loaded, limit) // 8)
    tree = _load(path, loaded) if loaded else {}
    for name, shape, kind in variables:
        numbers = np.zeros((), dtype=complex if name in complex_names else float)
        if kind in _NUMERIC and math.prod(shape) != 1:
            tree[name] = np.broadcast_to(numbers, shape)
        else:
            tree.setdefault(name, None)
    return {name: tree[name] for name, _, _ in variables}


def _load(path: Path, names: Iterable[str]) -> dict[str, Any]:
    """Return the variables of these names; structures as dictionaries, text as str."""
    import scipy.io

    return scipy.io.loadmat(
        path, appendmat=False, simplify_cells=True, variable_names=sorted(names)
    )


def _leaves(
    tree: Mapping[str, Any], prefix: str = "", outer: Sequence[Mapping[str, Statement]] = ()
) -> Iterator[tuple[str, Any, list[Mapping[str, Statement]]]]:
    """Yield name, value and the statements about it, nearest first, of all but structures."""
    stated = {name: value for name, value in tree.items() if _is_statement(name, value)}
    levels = [statements(stated), *outer]
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{name}.", levels)
        else:
            yield f"{prefix}{name}", value, levels


def _is_statement(name: str, value: Any) -> bool:
    """Return whether a variable is a statement about the arrays beside it, and no column."""
    numbers = isinstance(value, np.ndarray) and value.dtype.kind in "iufbc" and value.size != 1
    return bool(meaning_of(name)[0]) and value is not None and not numbers


def _elements(path: Path) -> Iterator[_Element]:
    """Yield the variables of a file of version 5; none of version 4, which has no structures.

    Source: MAT-File Format, The MathWorks, chapter 1.
    """
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
        order = "little" if header.endswith(b"IM") else "big"
        if 0 in header[:4]:
            return
        while len(tag := stream.read(8)) == 8:
            size = int.from_bytes(tag[4:], order)
            begin = stream.tell()
            is_compressed = int.from_bytes(tag[:4], order) == _COMPRESSED
            head = stream.read(min(size, 4096))
            if is_compressed:
                head = zlib.decompressobj().decompress(head, 4096)[8:]
            flags = int.from_bytes(head[8:12], order)
            at = 24 + -(-int.from_bytes(head[20:24], order) // 8) * 8  # behind the dimensions
            length = int.from_bytes(head[at : at + 4], order) >> 16  # of a name of four letters
            if length == 0:
                length = int.from_bytes(head[at + 4 : at + 8], order)
                at += 4
            name = head[at + 4 : at + 4 + length].decode("latin-1")
            yield _Element(name, bool(flags & _COMPLEX), begin, size, is_compressed)
            stream.seek(begin + size)


def _unpacked_bytes(path: Path, names: Container[str], limit: float) -> int:
    """Return how many bytes these variables unpack to; counting ends at the limit."""
    total = 0
    with path.open("rb") as stream:
        for element in _elements(path):
            if element.name not in names:
                continue
            if not element.is_compressed:
                total += element.size
                continue
            stream.seek(element.begin)
            unpacker = zlib.decompressobj()
            packed = stream.read(element.size)
            while packed and total <= limit:
                total += len(unpacker.decompress(packed, _PIECE_BYTES))
                packed = unpacker.unconsumed_tail
    return total


def _reason_against(value: Any, kind: str) -> str:
    """Return why a variable or a field is no column."""
    if kind in _NUMERIC or isinstance(value, np.ndarray | int | float):
        shape = np.shape(value)
        numeric = np.asarray(value).dtype.kind in "iufbc"
        return f"of shape {shape}" if numeric else "a MATLAB cell or object and no numeric array"
    return f"a MATLAB {kind or type(value).__name__} and not a numeric array"


MATLAB = Reader(
    name="matlab", title="MATLAB, every version", endings=(".mat",), open=open_matlab_file
)

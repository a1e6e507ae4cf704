"""MATLAB files of version 5 to 7.2: numbers, text and structures, and nothing that would be code.

Source: MAT-File Format, The MathWorks, chapter 1. SciPy's reader ends the process on structures
that are damaged.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import memory_for, require_room

_HEADER_BYTES = 128
_HEAD_BYTES = 4096
_PIECE_BYTES = 1 << 20
_COMPRESSED = 15
_IS_COMPLEX = 0x0800
_CELL = 1
_STRUCT = 2
_CHAR = 4
_NUMERIC = range(6, 16)  # classes double, single, int8 to uint64
_CLASSES = {
    1: "cell", 2: "struct array", 3: "object", 4: "char", 5: "sparse", 16: "function_handle",
    17: "object", 18: "object",
}  # fmt: skip
_WITHOUT_SHAPE = (16, 17)
_TYPES = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
    16: "u1", 17: "u2", 18: "u4",
}  # fmt: skip
_MAX_AXES = 32  # of an array
_MAX_DEPTH = 50  # of structures in structures
_MAX_ITEMS = 100_000  # cells, or structures of an array


@dataclass(frozen=True)
class UnsupportedVariable:
    """Variable that is neither numbers nor text nor one structure."""

    kind: str


@dataclass(frozen=True)
class _Head:
    """Head of a variable, in front of its contents."""

    name: str
    kind: int  # class
    shape: tuple[int, ...]
    is_complex: bool
    end: int  # place behind it


@dataclass(frozen=True)
class Numbers:
    """A numeric array, not yet converted."""

    shape: tuple[int, ...]
    is_complex: bool
    element: Element
    at: int  # place of the real parts in the element

    def array(self) -> Any:
        """Return the array as it is stored; ValueError where it is cut short."""
        components = []
        at = self.at
        for _ in range(2 if self.is_complex else 1):
            numbers, at = self.element.numbers(at)
            if numbers.size != math.prod(self.shape):
                raise ValueError(f"{numbers.size} numbers in an array of shape {self.shape}")
            components.append(numbers.reshape(self.shape, order="F"))
        return components[0] + 1j * components[1] if self.is_complex else components[0]


@dataclass(frozen=True)
class Element:
    """The bytes of a variable, or their beginning."""

    data: bytes
    order: str  # "<" or ">"

    def tag(self, at: int) -> tuple[int, int, int, int]:
        """Return type, begin and end of the contents of an element, and the place of the next."""
        first, size = (int(n) for n in np.frombuffer(self.data, f"{self.order}u4", 2, at))
        if first >> 16:  # up to four bytes, within the tag
            return first & 0xFFFF, at + 4, at + 4 + (first >> 16), at + 8
        return first, at + 8, at + 8 + size, at + 8 + -(-size // 8) * 8

    def numbers(self, at: int) -> tuple[Any, int]:
        """Return the numbers of an element and the place of the next; ValueError for others."""
        kind, begin, end, following = self.tag(at)
        dtype = np.dtype(f"{self.order}{_TYPES[kind]}")
        return np.frombuffer(self.data, dtype, (end - begin) // dtype.itemsize, begin), following

    def text(self, at: int) -> tuple[str, int]:
        """Return the letters of an element and the place of the next."""
        kind, begin, end, following = self.tag(at)
        if kind in (4, 17, 18):
            return "".join(map(chr, self.numbers(at)[0])), following
        return self.data[begin:end].decode("utf-8", "replace"), following


def variables(path: Path) -> dict[str, Any]:
    """Return name → variable: Numbers, text, a list of texts, a dictionary of fields, or Other.

    Arrays of numbers, but for single ones, are not read beyond their heads. Errors as
    ``variable_at``.
    """
    by_name: dict[str, Any] = {}
    for element, begin, size in _elements(path):
        head = _head(element, 0)
        if head.kind in _NUMERIC and math.prod(head.shape) != 1:
            by_name[head.name] = Numbers(head.shape, head.is_complex, element, head.end)
        else:
            by_name[head.name] = _contents(variable_at(path, element.order, begin, size), 0)
    return by_name


def numbers_of(path: Path, names: list[str]) -> Any:
    """Return the array at a path of names through the structures of a file."""
    for element, begin, size in _elements(path):
        if _head(element, 0).name == names[0]:
            value = _contents(variable_at(path, element.order, begin, size), 0)
            for name in names[1:]:
                value = value[name]
            return value.array()
    raise ValueError(f"no variable {names[0]!r}")


def variable_at(path: Path, order: str, begin: int, size: int) -> Element:
    """Return the variable whose element is at a place; InputError if it unpacks to too much."""
    limit = memory_for(path.stat().st_size)
    with path.open("rb") as stream:
        stream.seek(begin)
        kind = int(np.frombuffer(stream.read(8), f"{order}u4", 1)[0])
        data = stream.read(size)
    if kind != _COMPRESSED:
        return Element(data, order)
    unpacker = zlib.decompressobj()
    pieces: list[bytes] = []
    total = 0
    while data and not unpacker.eof:
        pieces.append(unpacker.decompress(data, _PIECE_BYTES))
        data = unpacker.unconsumed_tail
        total += len(pieces[-1])
        if total > limit:
            require_room(path, total)
    return Element(b"".join(pieces)[8:], order)


def _elements(path: Path) -> Iterator[tuple[Element, int, int]]:
    """Yield the head of each variable, its place in the file, and its size, in bytes."""
    with path.open("rb") as stream:
        order = "<" if stream.read(_HEADER_BYTES).endswith(b"IM") else ">"
        begin = _HEADER_BYTES
        while len(tag := stream.read(8)) == 8:
            kind, size = (int(n) for n in np.frombuffer(tag, f"{order}u4"))
            head = stream.read(min(size, _HEAD_BYTES))
            if kind == _COMPRESSED:
                head = zlib.decompressobj().decompress(head, _HEAD_BYTES)[8:]
            yield Element(head, order), begin, size
            begin += 8 + size
            stream.seek(begin)


def _head(element: Element, at: int) -> _Head:
    """Return what stands in front of the contents of a matrix at a place of an element."""
    flags, at = element.numbers(at)
    kind = int(flags[0]) & 0xFF
    shape: tuple[int, ...] = ()
    if kind not in _WITHOUT_SHAPE:
        dimensions, at = element.numbers(at)
        shape = tuple(int(length) for length in dimensions)
    if len(shape) > _MAX_AXES or min(shape, default=0) < 0:
        raise ValueError(f"an array of shape {shape}")
    name, at = element.text(at)
    return _Head(name, kind, shape, bool(flags[0] & _IS_COMPLEX), at)


def _contents(element: Element, at: int, depth: int = 0) -> Any:
    """Return the value of a matrix at a place of an element."""
    if depth > _MAX_DEPTH:
        raise ValueError(f"structures within structures, more than {_MAX_DEPTH}")
    head = _head(element, at)
    at = head.end
    count = math.prod(head.shape)
    if head.kind in _NUMERIC:
        return Numbers(head.shape, head.is_complex, element, at)
    if head.kind == _CHAR and min(head.shape, default=0) == 1:
        return element.text(at)[0]
    if head.kind == _STRUCT and count == 1:
        (length,), at = element.numbers(at)
        letters, at = element.text(at)
        fields = [
            letters[n : n + int(length)].partition("\0")[0]
            for n in range(0, len(letters), int(length))
        ]
        return dict(zip(fields, _matrices(element, at, len(fields), depth), strict=True))
    if head.kind == _CELL and 0 < count <= _MAX_ITEMS:
        cells = list(_matrices(element, at, count, depth))
        return (
            cells if all(isinstance(cell, str) for cell in cells) else UnsupportedVariable("cell")
        )
    return UnsupportedVariable(_CLASSES.get(head.kind, f"class {head.kind}"))


def _matrices(element: Element, at: int, count: int, depth: int) -> Iterator[Any]:
    """Yield the values of matrices one behind the other."""
    for _ in range(count):
        _, begin, end, at = element.tag(at)
        yield (
            _contents(element, begin, depth + 1)
            if end > begin
            else UnsupportedVariable("empty array")
        )

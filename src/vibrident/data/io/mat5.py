"""Read MATLAB files of version 5 to 7.2: numbers, text and structures, but no objects.

Source: MAT-File Format, The MathWorks, chapter 1. SciPy's reader crashes the process on damaged
structures.
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

_FILE_HEADER_BYTES = 128
_MAX_HEADER_BYTES = 4096  # of a variable
_BLOCK_BYTES = 1 << 20  # that are unpacked at once
_MAX_AXES = 32  # of an array
_MAX_DEPTH = 50  # of structures in structures
_MAX_ITEMS = 100_000  # cells, or structures of an array
_IS_COMPLEX = 0x0800  # flag of an array
#: Type of a compressed element.
_COMPRESSED = 15
#: Type of an element → NumPy's type of its numbers.
_TYPES = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
    16: "u1", 17: "u2", 18: "u4",
}  # fmt: skip
#: Types of text of two or four bytes a character.
_WIDE_TEXT = (4, 17, 18)
#: Classes of arrays.
_CELL = 1
_STRUCT = 2
_CHAR = 4
_NUMERIC = range(6, 16)  # double, single, int8 to uint64
_WITHOUT_SHAPE = (16, 17)
_CLASS_NAMES = {
    1: "cell", 2: "struct array", 3: "object", 4: "char", 5: "sparse", 16: "function_handle",
    17: "object", 18: "object",
}  # fmt: skip


@dataclass(frozen=True)
class UnsupportedVariable:
    """Variable that is neither numbers nor text nor one structure."""

    kind: str


@dataclass(frozen=True)
class _ArrayHeader:
    """Header of an array, in front of its contents."""

    name: str
    array_class: int
    shape: tuple[int, ...]
    is_complex: bool
    end: int  # offset of the contents


@dataclass(frozen=True)
class Numbers:
    """Numeric array, not yet converted."""

    shape: tuple[int, ...]
    is_complex: bool
    element: Element
    offset: int  # of the real parts in the element

    def array(self) -> Any:
        """Return the array as it is stored.

        Raises:
            ValueError: it is cut short.
        """
        components = []
        offset = self.offset
        for _ in range(2 if self.is_complex else 1):
            numbers, offset = self.element.numbers(offset)
            if numbers.size != math.prod(self.shape):
                raise ValueError(f"{numbers.size} numbers in an array of shape {self.shape}")
            components.append(numbers.reshape(self.shape, order="F"))
        return components[0] + 1j * components[1] if self.is_complex else components[0]


@dataclass(frozen=True)
class Element:
    """Bytes of a variable, or their beginning."""

    data: bytes
    byte_order: str  # "<" or ">"

    def tag(self, offset: int) -> tuple[int, int, int, int]:
        """Return type, begin and end of the element at an offset, and the offset of the next."""
        kind, size = map(int, np.frombuffer(self.data, f"{self.byte_order}u4", 2, offset))
        if kind >> 16:  # up to four bytes, within the tag
            return kind & 0xFFFF, offset + 4, offset + 4 + (kind >> 16), offset + 8
        begin = offset + 8
        return kind, begin, begin + size, begin + -(-size // 8) * 8

    def numbers(self, offset: int) -> tuple[Any, int]:
        """Return the numbers of the element at an offset, and the offset of the next.

        Raises:
            ValueError, KeyError: it holds no numbers, or is cut short.
        """
        kind, begin, end, following = self.tag(offset)
        dtype = np.dtype(f"{self.byte_order}{_TYPES[kind]}")
        return np.frombuffer(self.data, dtype, (end - begin) // dtype.itemsize, begin), following

    def text(self, offset: int) -> tuple[str, int]:
        """Return the text of the element at an offset, and the offset of the next."""
        kind, begin, end, following = self.tag(offset)
        if kind in _WIDE_TEXT:
            return "".join(map(chr, self.numbers(offset)[0])), following
        return self.data[begin:end].decode("utf-8", "replace"), following


def read_variables(path: Path) -> dict[str, Any]:
    """Return name → variable of a file.

    A variable is :class:`Numbers`, a text, a list of texts, a dictionary of the fields of a
    structure, or an :class:`UnsupportedVariable`. Of an array with several numbers only the header
    is read.

    Raises:
        InputError: a variable unpacks to more bytes than the file may take.
    """
    by_name: dict[str, Any] = {}
    for element, begin, size in _elements(path):
        header = _read_header(element, 0)
        if header.array_class in _NUMERIC and math.prod(header.shape) != 1:
            value: Any = Numbers(header.shape, header.is_complex, element, header.end)
        else:
            value = _read_array(_read_element(path, element.byte_order, begin, size), 0)
        by_name[header.name] = value
    return by_name


def read_numbers(path: Path, names: list[str]) -> Any:
    """Return the array at a path of names through the structures of a file.

    Raises:
        ValueError: there is no such variable.
        InputError: it unpacks to more bytes than the file may take.
    """
    for element, begin, size in _elements(path):
        if _read_header(element, 0).name == names[0]:
            value = _read_array(_read_element(path, element.byte_order, begin, size), 0)
            for name in names[1:]:
                value = value[name]
            return value.array()
    raise ValueError(f"no variable {names[0]!r}")


def _read_element(path: Path, byte_order: str, begin: int, size: int) -> Element:
    """Return the whole element of ``size`` bytes at an offset of the file."""
    limit = memory_for(path.stat().st_size)
    with path.open("rb") as stream:
        stream.seek(begin)
        kind = int(np.frombuffer(stream.read(8), f"{byte_order}u4", 1)[0])
        data = stream.read(size)
    if kind != _COMPRESSED:
        return Element(data, byte_order)
    unpacker = zlib.decompressobj()
    unpacked = bytearray()
    while data and not unpacker.eof:
        unpacked += unpacker.decompress(data, _BLOCK_BYTES)
        data = unpacker.unconsumed_tail
        if len(unpacked) > limit:
            require_room(path, len(unpacked))
    return Element(bytes(unpacked[8:]), byte_order)


def _elements(path: Path) -> Iterator[tuple[Element, int, int]]:
    """Yield the beginning of each variable, its offset in the file, and its size in bytes."""
    with path.open("rb") as stream:
        byte_order = "<" if stream.read(_FILE_HEADER_BYTES).endswith(b"IM") else ">"
        begin = _FILE_HEADER_BYTES
        while len(tag := stream.read(8)) == 8:
            kind, size = map(int, np.frombuffer(tag, f"{byte_order}u4"))
            data = stream.read(min(size, _MAX_HEADER_BYTES))
            if kind == _COMPRESSED:
                data = zlib.decompressobj().decompress(data, _MAX_HEADER_BYTES)[8:]
            yield Element(data, byte_order), begin, size
            begin += 8 + size
            stream.seek(begin)


def _read_header(element: Element, offset: int) -> _ArrayHeader:
    """Return the header of the array at an offset of an element."""
    flags, offset = element.numbers(offset)
    array_class = int(flags[0]) & 0xFF
    shape: tuple[int, ...] = ()
    if array_class not in _WITHOUT_SHAPE:
        lengths, offset = element.numbers(offset)
        shape = tuple(map(int, lengths))
    if len(shape) > _MAX_AXES or min(shape, default=0) < 0:
        raise ValueError(f"an array of shape {shape}")
    name, offset = element.text(offset)
    return _ArrayHeader(name, array_class, shape, bool(flags[0] & _IS_COMPLEX), offset)


def _read_array(element: Element, offset: int, depth: int = 0) -> Any:
    """Return the value of the array at an offset of an element."""
    if depth > _MAX_DEPTH:
        raise ValueError(f"structures within structures, more than {_MAX_DEPTH}")
    header = _read_header(element, offset)
    offset = header.end
    count = math.prod(header.shape)
    if header.array_class in _NUMERIC:
        return Numbers(header.shape, header.is_complex, element, offset)
    if header.array_class == _CHAR and min(header.shape, default=0) == 1:
        return element.text(offset)[0]
    if header.array_class == _STRUCT and count == 1:
        (length,), offset = element.numbers(offset)
        text, offset = element.text(offset)
        padded = [text[begin : begin + length] for begin in range(0, len(text), int(length))]
        fields = [name.partition("\0")[0] for name in padded]
        return dict(zip(fields, _read_arrays(element, offset, len(fields), depth), strict=True))
    if header.array_class == _CELL and 0 < count <= _MAX_ITEMS:
        cells = list(_read_arrays(element, offset, count, depth))
        if all(isinstance(cell, str) for cell in cells):
            return cells
        return UnsupportedVariable("cell")
    unsupported = _CLASS_NAMES.get(header.array_class, f"class {header.array_class}")
    return UnsupportedVariable(unsupported)


def _read_arrays(element: Element, offset: int, count: int, depth: int) -> Iterator[Any]:
    """Yield the values of arrays that follow each other."""
    for _ in range(count):
        _, begin, end, offset = element.tag(offset)
        if end > begin:
            yield _read_array(element, begin, depth + 1)
        else:
            yield UnsupportedVariable("empty array")

"""Read MATLAB files of version 5 to 7.2: numbers, text and structures, but no objects.

Source: MAT-File Format, The MathWorks, chapter 1. SciPy's reader crashes the process on damaged
structures.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
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
class Numbers:
    """Numeric array, not yet converted.

    Attributes:
        shape: of the array.
        is_complex: whether the imaginary parts follow the real ones.
        contents: reads the bytes of the numbers.
    """

    shape: tuple[int, ...]
    is_complex: bool
    contents: Callable[[], _VariableElements]

    def array(self) -> Any:
        """Return the array as it is stored.

        Raises:
            ValueError: it is cut short.
        """
        elements = self.contents()
        components = [elements.numbers() for _ in range(1 + self.is_complex)]
        if any(numbers.size != math.prod(self.shape) for numbers in components):
            sizes = [numbers.size for numbers in components]
            raise ValueError(f"{sizes} numbers in an array of shape {self.shape}")
        real, *imag = (numbers.reshape(self.shape, order="F") for numbers in components)
        return real + 1j * imag[0] if imag else real


@dataclass(frozen=True)
class _ArrayHeader:
    """Header of an array, in front of its contents."""

    name: str
    array_class: int
    shape: tuple[int, ...]
    is_complex: bool


@dataclass
class _VariableElements:
    """Elements of a variable, or of its beginning, which are taken one after the other.

    ValueError and KeyError where an element is not of the kind that is taken, or is cut short.
    """

    data: bytes | memoryview
    byte_order: str  # "<" or ">"
    offset: int = 0

    def take(self) -> tuple[int, memoryview]:
        """Return type and content of the next element."""
        kind, size = map(int, np.frombuffer(self.data, f"{self.byte_order}u4", 2, self.offset))
        begin = self.offset + 8
        self.offset = begin + -(-size // 8) * 8
        if kind >> 16:  # up to four bytes, within the tag
            self.offset = begin
            begin -= 4
            size = kind >> 16
        return kind & 0xFFFF, memoryview(self.data)[begin : begin + size]

    def numbers(self) -> Any:
        """Return the numbers of the next element."""
        kind, content = self.take()
        return np.frombuffer(content, f"{self.byte_order}{_TYPES[kind]}")

    def text(self) -> str:
        """Return the text of the next element."""
        kind, content = self.take()
        if kind in _WIDE_TEXT:
            return "".join(map(chr, np.frombuffer(content, f"{self.byte_order}{_TYPES[kind]}")))
        return bytes(content).decode("utf-8", "replace")

    def header(self) -> _ArrayHeader:
        """Return the header of the next array."""
        flags = self.numbers()
        array_class = int(flags[0]) & 0xFF
        shape: tuple[int, ...] = ()
        if array_class not in _WITHOUT_SHAPE:
            shape = tuple(map(int, self.numbers()))
        if len(shape) > _MAX_AXES or min(shape, default=0) < 0:
            raise ValueError(f"an array of shape {shape}")
        return _ArrayHeader(self.text(), array_class, shape, bool(flags[0] & _IS_COMPLEX))

    def array(self, depth: int = 0) -> Any:
        """Return the value of the next array."""
        if depth > _MAX_DEPTH:
            raise ValueError(f"structures within structures, more than {_MAX_DEPTH}")
        header = self.header()
        count = math.prod(header.shape)
        if header.array_class in _NUMERIC:
            return Numbers(header.shape, header.is_complex, partial(replace, self))
        if header.array_class == _CHAR and min(header.shape, default=0) == 1:
            return self.text()
        if header.array_class == _CHAR and len(header.shape) == 2 and 0 < count <= _MAX_ITEMS:
            text = self.text()  # by columns; its rows are padded
            return [text[row :: header.shape[0]].rstrip() for row in range(header.shape[0])]
        if header.array_class == _STRUCT and count == 1:
            (length,) = self.numbers()
            text = self.text()
            padded = [text[begin : begin + length] for begin in range(0, len(text), int(length))]
            fields = [name.partition("\0")[0] for name in padded]
            return dict(zip(fields, self._arrays(len(fields), depth), strict=True))
        if header.array_class == _CELL and 0 < count <= _MAX_ITEMS:
            cells = list(self._arrays(count, depth))
            is_text = all(isinstance(cell, str) for cell in cells)
            return cells if is_text else UnsupportedVariable("cell")
        unsupported = _CLASS_NAMES.get(header.array_class, f"class {header.array_class}")
        return UnsupportedVariable(unsupported)

    def _arrays(self, count: int, depth: int) -> Iterator[Any]:
        """Yield the values of arrays, each of which is an element."""
        for _ in range(count):
            _, content = self.take()
            if content:
                yield _VariableElements(content, self.byte_order).array(depth + 1)
            else:
                yield UnsupportedVariable("empty array")


def read_variables(path: Path) -> dict[str, Any]:
    """Return name → variable of a file.

    A variable is :class:`Numbers`, a text, a list of texts, a dictionary of the fields of a
    structure, or an :class:`UnsupportedVariable`. Of an array with several numbers only the header
    is read.

    Raises:
        InputError: a variable unpacks to more bytes than the file may take.
    """
    by_name: dict[str, Any] = {}
    with path.open("rb") as stream:
        byte_order = "<" if stream.read(_FILE_HEADER_BYTES).endswith(b"IM") else ">"
        begin = _FILE_HEADER_BYTES
        while len(tag := stream.read(8)) == 8:
            kind, size = map(int, np.frombuffer(tag, f"{byte_order}u4"))
            data = stream.read(min(size, _MAX_HEADER_BYTES))
            if kind == _COMPRESSED:
                data = zlib.decompressobj().decompress(data, _MAX_HEADER_BYTES)[8:]
            header = _VariableElements(data, byte_order).header()
            variable = partial(_read_variable, path, byte_order, begin, size)
            if header.array_class in _NUMERIC and math.prod(header.shape) != 1:
                contents = partial(_contents, variable)
                by_name[header.name] = Numbers(header.shape, header.is_complex, contents)
            else:
                by_name[header.name] = variable().array()
            begin += 8 + size
            stream.seek(begin)
    return by_name


def _contents(variable: Callable[[], _VariableElements]) -> _VariableElements:
    """Return the elements of a variable behind its header."""
    elements = variable()
    elements.header()
    return elements


def _read_variable(path: Path, byte_order: str, begin: int, size: int) -> _VariableElements:
    """Return the elements of a variable of ``size`` bytes at an offset of the file."""
    limit = memory_for(path.stat().st_size)
    with path.open("rb") as stream:
        stream.seek(begin)
        kind = int(np.frombuffer(stream.read(8), f"{byte_order}u4", 1)[0])
        data = stream.read(size)
    if kind != _COMPRESSED:
        return _VariableElements(data, byte_order)
    unpacker = zlib.decompressobj()
    unpacked = bytearray()
    while data and not unpacker.eof:
        unpacked += unpacker.decompress(data, _BLOCK_BYTES)
        data = unpacker.unconsumed_tail
        if len(unpacked) > limit:
            require_room(path, len(unpacked))
    return _VariableElements(bytes(unpacked[8:]), byte_order)

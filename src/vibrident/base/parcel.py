"""Send values through a pipe without pickle, so that a sender can create only harmless objects.

These are numbers, text, bytes, paths, lists, tuples, mappings, arrays of numbers, and dataclasses
of this package. Each value is one line of JSON; the raw bytes of its arrays follow the line.
"""

from __future__ import annotations

import hashlib
import importlib
import io
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path, PurePath
from typing import IO, Any

import numpy as np

_ALIGNMENT_BYTES = 16
_PACKAGE = "vibrident."


class TooLong(Exception):
    """Value that takes more bytes than allowed."""


def send(stream: IO[bytes] | io.RawIOBase, value: Any) -> None:
    """Write a value.

    Raises:
        TypeError: the value holds an object of another type; nothing is written.
    """
    buffers: list[memoryview] = []
    tree = _encoded(value, buffers)
    length = sum(len(buffer) + _padding(len(buffer)) for buffer in buffers)
    stream.write(json.dumps([length, tree]).encode() + b"\n")
    for buffer in buffers:
        stream.write(buffer)
        stream.write(bytes(_padding(len(buffer))))
    stream.flush()


def _padding(length: int) -> int:
    """Return how many bytes follow an array of ``length`` bytes, so that the next is aligned."""
    return -length % _ALIGNMENT_BYTES


def sha256(value: Any) -> str:
    """Return the SHA-256 of a value as it is sent, in hexadecimal.

    Raises:
        TypeError: the value holds an object of another type.
    """
    digest = hashlib.sha256()

    class DigestStream(io.RawIOBase):
        def write(self, content: Any) -> int:
            digest.update(content)
            return len(content)

    send(DigestStream(), value)
    return digest.hexdigest()


def receive(stream: IO[bytes], max_bytes: int) -> Any:
    """Read the next value; its arrays may be written to.

    Raises:
        EOFError: the stream ended before the value did.
        TooLong: the value takes more than ``max_bytes``.
        ValueError, TypeError, KeyError, RecursionError: the bytes were not written by :func:`send`.
    """
    line = stream.readline(max_bytes + 1)
    if len(line) > max_bytes:
        raise TooLong(f"a message of more than {max_bytes} bytes")
    if not line.endswith(b"\n"):
        raise EOFError
    length, tree = json.loads(line)
    if not 0 <= length <= max_bytes - len(line):
        raise TooLong(f"a message of more than {max_bytes} bytes")
    content = bytearray(length)
    if stream.readinto(content) != length:  # type: ignore[attr-defined]
        raise EOFError
    return _decoded(tree, _Buffers(memoryview(content)))


class _Buffers:
    """Raw bytes of arrays, one after another in the order of the tree."""

    def __init__(self, content: memoryview) -> None:
        self._content = content
        self._offset = 0

    def next(self, length: int) -> memoryview:
        """Return the next ``length`` bytes; ValueError where there are not as many."""
        buffer = self._content[self._offset : self._offset + length]
        if length < 0 or len(buffer) != length:
            raise ValueError("an array without its bytes")
        self._offset += length + _padding(length)
        return buffer


def _encoded(value: Any, buffers: list[memoryview]) -> Any:
    """Return the value in JSON's types: scalars as they are, anything else as [kind, …]."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple):
        name = "list" if isinstance(value, list) else "tuple"
        return [name, *(_encoded(item, buffers) for item in value)]
    if isinstance(value, Mapping):
        pairs = ([_encoded(key, buffers), _encoded(item, buffers)] for key, item in value.items())
        return ["mapping", *pairs]
    if isinstance(value, PurePath):
        return ["path", str(value)]
    if isinstance(value, bytes | bytearray):
        buffers.append(memoryview(value))
        return ["bytes", len(value)]
    if isinstance(value, np.ndarray) and value.dtype.kind in "iufcb":
        contiguous = np.ascontiguousarray(value)
        buffers.append(contiguous.reshape(-1).view(np.uint8).data)
        return ["array", contiguous.dtype.str, list(value.shape), contiguous.nbytes]
    kind = type(value)
    if is_dataclass(value) and kind.__module__.startswith(_PACKAGE):
        contents = [
            [f.name, _encoded(getattr(value, f.name), buffers)] for f in fields(value) if f.init
        ]
        return ["dataclass", kind.__module__, kind.__qualname__, contents]
    raise TypeError(f"a {kind.__module__}.{kind.__qualname__} cannot be sent")


def _decoded(tree: Any, buffers: _Buffers) -> Any:
    if not isinstance(tree, list):
        return tree
    kind, *items = tree
    match kind:
        case "list":
            return [_decoded(item, buffers) for item in items]
        case "tuple":
            return tuple(_decoded(item, buffers) for item in items)
        case "mapping":
            return {_decoded(key, buffers): _decoded(item, buffers) for key, item in items}
        case "path":
            return Path(items[0])
        case "bytes":
            return bytes(buffers.next(items[0]))
        case "array":
            return _array(items, buffers)
        case "dataclass":
            return _dataclass(items, buffers)
    raise ValueError(f"no kind {kind!r} is known")


def _array(description: list[Any], buffers: _Buffers) -> Any:
    dtype, shape, length = description
    kind = np.dtype(dtype)
    if kind.kind not in "iufcb":
        raise ValueError(f"an array of {dtype}")
    return np.frombuffer(buffers.next(length), kind).reshape(shape)


def _dataclass(description: list[Any], buffers: _Buffers) -> Any:
    module, name, contents = description
    if not module.startswith(_PACKAGE):
        raise ValueError(f"a class of {module}")
    loaded = getattr(importlib.import_module(module), name, None)
    if not (isinstance(loaded, type) and is_dataclass(loaded) and loaded.__module__ == module):
        raise ValueError(f"no dataclass {module}.{name}")
    return loaded(**{key: _decoded(item, buffers) for key, item in contents})

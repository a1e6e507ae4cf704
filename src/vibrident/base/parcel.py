"""Send values through a pipe without pickle: a sender can create no other objects than these.

Numbers, text, bytes, paths, lists, tuples, mappings, arrays of numbers, and dataclasses of this
package. Each value is one line of JSON; the raw bytes of its arrays follow the line.
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
    tree = _plain(value, buffers)
    line = json.dumps(
        [sum(len(buffer) + -len(buffer) % _ALIGNMENT_BYTES for buffer in buffers), tree]
    )
    stream.write(line.encode() + b"\n")
    for buffer in buffers:
        stream.write(buffer)
        stream.write(bytes(-len(buffer) % _ALIGNMENT_BYTES))
    stream.flush()


def sha256(value: Any) -> str:
    """Return the SHA-256 of a value as it is sent, in hexadecimal.

    Raises:
        TypeError: the value holds an object of another type.
    """
    total = hashlib.sha256()

    class Stream(io.RawIOBase):
        def write(self, content: Any) -> int:
            total.update(content)
            return len(content)

    send(Stream(), value)
    return total.hexdigest()


def receive(stream: IO[bytes], most_bytes: int) -> Any:
    """Read the next value; its arrays may be written to.

    Raises:
        EOFError: the stream ended before the value did.
        TooLong: the value takes more than ``most_bytes``.
        ValueError, TypeError, KeyError, RecursionError: the bytes were not written by :func:`send`.
    """
    line = stream.readline(most_bytes + 1)
    if len(line) > most_bytes:
        raise TooLong(f"a message of more than {most_bytes} bytes")
    if not line.endswith(b"\n"):
        raise EOFError
    length, tree = json.loads(line)
    if not 0 <= length <= most_bytes - len(line):
        raise TooLong(f"a message of more than {most_bytes} bytes")
    content = bytearray(length)
    if stream.readinto(content) != length:  # type: ignore[attr-defined]
        raise EOFError
    return _value(tree, _Buffers(memoryview(content)))


class _Buffers:
    """Raw bytes of arrays, one after another in the order of the tree."""

    def __init__(self, content: memoryview) -> None:
        self._content = content
        self._offset = 0

    def take(self, length: int) -> memoryview:
        piece = self._content[self._offset : self._offset + length]
        if length < 0 or len(piece) != length:
            raise ValueError("an array without its bytes")
        self._offset += length + -length % _ALIGNMENT_BYTES
        return piece


def _plain(value: Any, buffers: list[memoryview]) -> Any:
    """Return the value in JSON's types: scalars as they are, anything else as [kind, …]."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple):
        return [
            "list" if isinstance(value, list) else "tuple",
            *(_plain(item, buffers) for item in value),
        ]
    if isinstance(value, Mapping):
        return [
            "mapping",
            *([_plain(key, buffers), _plain(item, buffers)] for key, item in value.items()),
        ]
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
        filled = [
            [f.name, _plain(getattr(value, f.name), buffers)] for f in fields(value) if f.init
        ]
        return ["dataclass", kind.__module__, kind.__qualname__, filled]
    raise TypeError(f"a {kind.__module__}.{kind.__qualname__} cannot be sent")


def _value(tree: Any, buffers: _Buffers) -> Any:
    if not isinstance(tree, list):
        return tree
    kind, *items = tree
    match kind:
        case "list":
            return [_value(item, buffers) for item in items]
        case "tuple":
            return tuple(_value(item, buffers) for item in items)
        case "mapping":
            return {_value(key, buffers): _value(item, buffers) for key, item in items}
        case "path":
            return Path(items[0])
        case "bytes":
            return bytes(buffers.take(items[0]))
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
    return np.frombuffer(buffers.take(length), kind).reshape(shape)


def _dataclass(description: list[Any], buffers: _Buffers) -> Any:
    module, name, filled = description
    if not module.startswith(_PACKAGE):
        raise ValueError(f"a class of {module}")
    loaded = getattr(importlib.import_module(module), name, None)
    if not (isinstance(loaded, type) and is_dataclass(loaded) and loaded.__module__ == module):
        raise ValueError(f"no dataclass {module}.{name}")
    return loaded(**{key: _value(item, buffers) for key, item in filled})

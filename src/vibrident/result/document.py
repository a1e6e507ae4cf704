"""Convert a result to and from a JSON document (RFC 8259), with the fields of later versions."""

from __future__ import annotations

import datetime
import functools
import json
import logging
import math
import os
import types
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from vibrident.base.brief import first_names
from vibrident.base.errors import InputError

SCHEMA = "vibrident.result/1"
#: Largest result file, bytes; one with hundreds of records has a few millions.
MAX_FILE_BYTES = 200_000_000
#: Most unknown fields that a message names.
MAX_NAMED_FIELDS = 8
_log = logging.getLogger("vibrident.result")
#: Name of the field of each part that holds the fields which this version does not know.
UNKNOWN = "unknown_fields"


def plain(value: Any) -> Any:
    """Return a value in JSON's types; numbers that are not finite become None."""
    if type(value) is float:  # by far the most
        return value if math.isfinite(value) else None
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if is_dataclass(value):
        part = {
            attribute.name: plain(getattr(value, attribute.name)) for attribute in fields(value)
        }
        return _with_unknown(part)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if value is None or isinstance(value, (str, int)):
        return value
    # The certificate of a calibration made in memory holds dates.
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    number = float(value)
    return number if math.isfinite(number) else None


def _with_unknown(document: dict[str, Any]) -> dict[str, Any]:
    """Return a part with its unknown fields among the known ones."""
    for name, value in document.pop(UNKNOWN, {}).items():
        document[name] = document[name] | value if name in document else value
    return document


def separate_unknown(kind: Any, value: Any) -> Any:
    """Return a document in which each part has its unknown fields under :data:`UNKNOWN`.

    Args:
        kind: type of the value: a dataclass, or a union, tuple or mapping of dataclasses; values of
            other types are returned as they are.
        value: in JSON's types. An entry of a mapping of texts that is no text counts as unknown.
    """
    if is_dataclass(kind):
        return _separate_fields(kind, value) if isinstance(value, Mapping) else value
    member = next(filter(is_dataclass, get_args(kind)), None)
    if member is None:
        return value
    if get_origin(kind) in (Union, types.UnionType):
        return separate_unknown(member, value)
    if get_origin(kind) is tuple and isinstance(value, list | tuple):
        return [separate_unknown(member, item) for item in value]
    if isinstance(value, Mapping):
        return {name: separate_unknown(member, item) for name, item in value.items()}
    return value


def _separate_fields(kind: Any, value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a part; those that its type lacks are under :data:`UNKNOWN`."""
    hints = _hints(kind)
    known_fields: dict[str, Any] = {}
    unknown_fields: dict[str, Any] = {}
    for name, item in value.items():
        if name == UNKNOWN or name not in hints:
            unknown_fields[name] = item
        elif hints[name] == Mapping[str, str] and isinstance(item, Mapping):
            texts = {key: text for key, text in item.items() if isinstance(text, str)}
            known_fields[name] = texts
            if len(texts) < len(item):
                unknown_fields[name] = {k: entry for k, entry in item.items() if k not in texts}
        else:
            known_fields[name] = separate_unknown(hints[name], item)
    return known_fields | ({UNKNOWN: unknown_fields} if unknown_fields else {})


@functools.cache
def _hints(kind: Any) -> dict[str, Any]:
    """Return the types of a part's fields, by name."""
    return get_type_hints(kind)


def unknown_names(value: Any, prefix: str = "") -> Iterator[str]:
    """Yield the place of each unknown field of a part and of all parts in it, as ``fit.name``."""
    items: Iterable[tuple[Any, Any]] = ()
    if isinstance(value, tuple):
        items = enumerate(value)
    elif isinstance(value, Mapping):
        items = value.items()
    elif is_dataclass(value):
        items = vars(value).items()
    for name, item in items:
        if name == UNKNOWN and is_dataclass(value):
            yield from (f"{prefix}{unknown}" for unknown in item)
        else:
            yield from unknown_names(item, f"{prefix}{name}.")


def json_text(document: Any) -> str:
    """Return a document as JSON, RFC 8259, with a list of plain values on one line.

    The byte of a file's name that is no UTF-8 becomes ``?``.

    Raises:
        ValueError: a number is not finite.
    """
    text = "".join(_layout(document, "\n")) + "\n"
    return text.encode(errors="replace").decode()


def _layout(value: Any, margin: str) -> Iterator[str]:
    """Yield the JSON text of a value; ``margin``: a line break and the blanks that begin a line."""
    nested = Mapping | list | tuple
    items: list[tuple[str, Any]] = []
    if isinstance(value, Mapping):
        items = [(f"{json.dumps(str(key), ensure_ascii=False)}: ", value[key]) for key in value]
    elif isinstance(value, list | tuple):
        items = [("", item) for item in value]
    if not any(isinstance(item, nested) for _, item in items):
        yield json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        return
    deeper = f"{margin}  "
    begin, end = "{}" if isinstance(value, Mapping) else "[]"
    for label, item in items:
        yield f"{begin}{deeper}{label}"
        yield from _layout(item, deeper)
        begin = ","
    yield margin + end


def refuse_constant(name: str) -> float:
    """Raise ValueError for NaN and Infinity, which are no numbers of JSON."""
    raise ValueError(f"{name}, which is no number of JSON")


def damaged(observation: str) -> InputError:
    """Return the error of a result file with a missing or unusable field."""
    return InputError(
        "The result file is incomplete or damaged.",
        expected=f"all fields of {SCHEMA}",
        found=observation[:500],
        remedy="run ⟦command = identify⟧ again",
    )


def read_document(path: str | os.PathLike[str]) -> Any:
    """Return the JSON document of a result file.

    Raises:
        InputError: the file cannot be read, or is no JSON.
    """
    try:
        file = Path(path)
        if (size := file.stat().st_size) > MAX_FILE_BYTES:
            raise ValueError(f"{size} bytes, which is more than any result has")
        document = json.loads(file.read_text(encoding="utf-8"), parse_constant=refuse_constant)
    # UnicodeDecodeError is a ValueError.
    except (OSError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(
            "The result file cannot be read.",
            expected="a JSON file written by ⟦command = identify⟧",
            found="no file of that name" if isinstance(error, FileNotFoundError) else str(error),
            where=str(path),
            remedy="give the path of a result.json, or write it anew by ⟦command = identify⟧",
        ) from error
    return document


@functools.cache  # once a file
def log_unknown(file: str, names: tuple[str, ...]) -> None:
    """Log a warning that names the fields of a file that this version does not know."""
    if names:
        named = first_names(names, MAX_NAMED_FIELDS)
        _log.warning(f"{file} holds what this version of vibrident does not know; kept: {named}")

"""Plain values as TOML text, as a calibration file needs it; refusal of text that is too costly to parse."""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

from vibrident.errors import InputError

#: Most bytes of a calibration file: ten thousand [[records]] entries. The standard parser takes a second for it.
MOST_BYTES = 1_000_000
#: A long chain of dotted keys; the parser's time and memory grow as the square of their number.
_JOINED = re.compile(r"""(?:\.[ \t]*(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*){32}""")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def refuse_costly(text: str, where: str) -> None:
    """Refuse text that is too costly to parse and not a calibration file.

    Raises:
        InputError: it is too long, or its keys are nested too deeply.
    """
    if len(text) > MOST_BYTES or (joined := _JOINED.search(text)):
        raise InputError(
            "This is not a calibration file.",
            expected=f"at most {MOST_BYTES} characters, and keys of one or two levels",
            found=f"{len(text)} characters" if len(text) > MOST_BYTES else f"{joined.group()[:40]!r} and so on",
            where=where,
            remedy="name data files under [[records]] file, many of them with a glob",
        )


def toml_section(header: str, values: Mapping[str, Any]) -> str:
    """Return a section: its header ("[sensor]", "[[records]]") and a line a key; None values are left out."""
    lines = [f"{toml_key(key)} = {toml_value(value)}" for key, value in values.items() if value is not None]
    return "\n".join((header, *lines)) + "\n"


def toml_key(key: str) -> str:
    """Return the key, quoted where it must be."""
    return key if _BARE_KEY.fullmatch(key) else _quoted(key)


def toml_value(value: Any) -> str:
    """Return a value; floats round-trip exactly, mappings become inline tables.

    Raises:
        TypeError: TOML has no such type.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, int):
        return repr(int(value))
    if isinstance(value, float):
        return repr(float(value))  # a NumPy float is a float with another repr
    if isinstance(value, datetime.datetime | datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{toml_key(str(k))} = {toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    raise TypeError(f"no TOML form for {type(value).__name__}")


def _quoted(text: str) -> str:
    # JSON's escapes are TOML's, but for DEL, which TOML does not allow unescaped.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")

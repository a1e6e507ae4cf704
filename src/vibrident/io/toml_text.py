"""Plain values as TOML text, as a calibration file needs it; refusal of text that is too costly to parse."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import tomli_w

from vibrident.errors import InputError

#: Most bytes of a calibration file: ten thousand [[records]] entries. The standard parser takes a second for it.
MOST_BYTES = 1_000_000
#: A long chain of dotted keys; the parser's time and memory grow as the square of their number.
_JOINED = re.compile(r"""(?:\.[ \t]*(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*){32}""")


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


def toml_section(name: str, values: Mapping[str, Any]) -> str:
    """Return the section ``[name]``, a line a key; None values are left out."""
    return tomli_w.dumps({name: _stated(values)})


def toml_entry(name: str, values: Mapping[str, Any]) -> str:
    """Return one entry ``[[name]]`` of plain values, likewise."""
    return f"[[{name}]]\n" + tomli_w.dumps(_stated(values))


def _stated(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}

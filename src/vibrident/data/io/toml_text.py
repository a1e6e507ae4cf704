"""TOML: files read, unless they are too costly to parse, and plain values written."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from vibrident.base.errors import InputError
from vibrident.data.io.columns import require_regular, unreadable
from vibrident.data.io.reader import by_ending

#: Most characters of a calibration file: ten thousand [[records]] entries. The standard parser
#: takes a second for it.
MAX_TOML_BYTES = 1_000_000
#: A long chain of dotted keys; the parser's time and memory grow as the square of their number.
_JOINED = re.compile(r"""(?:\.[ \t]*(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*){32}""")


def read_toml(path: Path, what: str = "calibration") -> dict[str, Any]:
    """Return the keys of a file, of a kind that ``what`` names.

    InputError for one that is not UTF-8 or not TOML, or too costly to parse.
    """
    kind = f"a {what} file (TOML)"
    require_regular(path, kind)
    try:
        return _parsed(path, what)
    except OSError as error:
        raise unreadable(str(path), error, kind) from error
    except InputError as error:
        if what == "calibration" and path.suffix.lower() in by_ending():
            raise _data_file(path, kind) from error
        raise


def _data_file(path: Path, kind: str) -> InputError:
    """Return the refusal of a data file where a calibration file belongs."""
    return InputError(
        "This is a data file; a calibration file says what its columns mean.",
        expected=kind,
        found=repr(path.name),
        where=str(path),
        remedy="write calibration.toml beside it: column and unit under [reference] and "
        "[response], rate_hz or time_column under [sampling], "
        f"file = {path.name!r} under [[records]]; or drop the file on the page of `serve`",
    )


def _parsed(path: Path, what: str) -> dict[str, Any]:
    """Return the keys of a file; errors as of :func:`read_toml`, and OSError."""
    try:
        with path.open("rb") as stream:
            text = stream.read(4 * MAX_TOML_BYTES + 4).decode("utf-8-sig")
        if len(text) > MAX_TOML_BYTES or (joined := _JOINED.search(text)):
            raise InputError(
                f"This is not a {what} file.",
                expected=f"at most {MAX_TOML_BYTES} characters, and keys of one or two levels",
                found=f"{len(text)} characters"
                if len(text) > MAX_TOML_BYTES
                else f"{joined.group()[:40]!r} and so on",
                where=str(path),
                remedy="name data files under [[records]] file, many of them with a glob",
            )
        return tomllib.loads(text.replace("\r\n", "\n"))
    except UnicodeDecodeError as error:
        raise InputError(
            f"The {what} file is not UTF-8 text.",
            expected="a TOML file in UTF-8",
            found=f"byte 0x{error.object[error.start]:02x}",
            where=f"{path}, line {error.object[: error.start].count(bytes([10])) + 1}",
            remedy="save it as UTF-8; data files belong under [[records]] file",
        ) from error
    # a number of thousands of digits; hundreds of nested brackets
    except (
        ValueError,
        RecursionError,
    ) as error:
        line = re.search(r"at line (\d+)", str(error))
        raise InputError(
            f"The {what} file is not valid TOML.",
            expected="TOML: [section], key = value, text in quotes",
            found=str(error),
            where=f"{path}, line {line.group(1)}" if line else f"{path}, end of the file",
            remedy="correct that line"
            if path.suffix.lower() == ".toml"
            else f"name a {what} file (.toml)",
        ) from error


def toml_document(document: Mapping[str, Any]) -> str:
    """Return a file of sections; of a list an entry each."""
    texts = []
    for name, values in document.items():
        several = isinstance(values, list)
        texts += [toml_entry(name, v) for v in values] if several else [toml_section(name, values)]
    return "\n".join(texts)


def toml_section(name: str, values: Mapping[str, Any]) -> str:
    """Return the section ``[name]``, a line a key; None values are left out."""
    return tomli_w.dumps({name: _without_empty(values)})


def toml_entry(name: str, values: Mapping[str, Any]) -> str:
    """Return one entry ``[[name]]`` of plain values, likewise."""
    return f"[[{name}]]\n" + tomli_w.dumps(_without_empty(values))


def _without_empty(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value is not None}

"""Define what a data format is, and choose the reader for a file's ending."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.data.io.columns import ColumnFile, require_regular, unreadable
from vibrident.data.registry import READERS

_SPREADSHEETS = frozenset({".xlsx", ".xlsm", ".xlsb", ".xls", ".ods", ".fods", ".numbers"})


@dataclass(frozen=True)
class Reader:
    """A data format that can be read."""

    name: str  # short name of the format
    title: str  # in a few words
    endings: tuple[str, ...]  # of its files, each with its dot, in lower case
    # path → the file opened; numbers are converted on demand. InputError: not of this format
    open: Callable[[Path], ColumnFile]
    # extra of vibrident, or package, that brings the library it needs; "" if it needs none
    extra: str = ""
    # no native library and no links, so that it needs no separate process (docs/security.md)
    plain: bool = False


def by_ending() -> dict[str, Reader]:
    """Return ending → reader, of plug-ins too; a built-in reader has precedence."""
    readers: dict[str, Reader] = {}
    for reader in READERS.all().values():
        for ending in reader.endings:
            readers.setdefault(ending, reader)
    return readers


def open_columns(path: Path) -> ColumnFile:
    """Open a data file with the reader for its ending; numbers are converted on demand.

    Raises:
        InputError: the ending is unknown, or the file is not of that format.
    """
    reader = by_ending().get(path.suffix.lower())
    if reader is None:
        raise unknown_format(path.suffix, str(path))
    require_regular(path, "a file")
    return reader.open(path)


def sha256(path: Path) -> str:
    """Return the hex digest of the bytes of a data file.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        state = path.stat()
        return _digest(path.resolve(), state.st_size, state.st_mtime_ns, state.st_ctime_ns)
    except OSError as error:
        raise unreadable(str(path), error, "a data file") from error


@functools.lru_cache(maxsize=64)  # a long file is read in many parts
def _digest(path: Path, size: int, written_ns: int, changed_ns: int) -> str:
    """Return the hex digest of a file of this size, last written and changed at these times."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def unknown_format(suffix: str, where: str) -> InputError:
    """Return the error of a file ending without a reader; a spreadsheet has its own."""
    if suffix.lower() in _SPREADSHEETS:
        return InputError(
            "A spreadsheet is not read.",
            expected="a text file of columns, such as CSV, or one of " + ", ".join(by_ending()),
            found=repr(suffix),
            where=where,
            remedy='open it and save the sheet as CSV ("CSV UTF-8"), one header line above the '
            "numbers",
        )
    return InputError(
        "The file's format is not known.",
        expected="a file ending in " + ", ".join(by_ending()),
        found=repr(suffix) if suffix else "no ending",
        where=where,
        remedy="rename the file, or export it as CSV or HDF5",
    )

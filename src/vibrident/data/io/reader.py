"""A data format: its name, its file endings, and its reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vibrident.data.io.columns import ColumnFile


@dataclass(frozen=True)
class Reader:
    """A data format that can be read."""

    name: str  # short name of the format
    title: str  # in a few words
    endings: tuple[str, ...]  # of its files, each with its dot, in lower case
    # path → the file opened; numbers are converted on demand. Raises InputError if the file is not of this format
    open: Callable[[Path], ColumnFile]
    extra: str = ""  # extra of vibrident, or package, that brings the library it needs; empty: it needs none
    plain: bool = False  # no native library and no links, so that it needs no separate process (docs/security.md)

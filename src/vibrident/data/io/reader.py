"""A data format: its name, its file endings, and its reader."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vibrident.data.io.columns import ColumnFile


@dataclass(frozen=True)
class Reader:
    """A data format that can be read.

    Attributes:
        name: short name of the format.
        title: in a few words.
        endings: of its files, each with its dot, in lower case.
        open: path → the file opened; numbers are converted on demand. Raises InputError if the file is not of this
            format.
        extra: extra of vibrident, or package, that brings the library it needs; empty: it needs none.
        plain: no native library and no links, so that it needs no separate process (docs/security.md).
    """

    name: str
    title: str
    endings: tuple[str, ...]
    open: Callable[[Path], ColumnFile]
    extra: str = ""
    plain: bool = False

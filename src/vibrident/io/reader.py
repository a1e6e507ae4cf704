"""What a data format is to the rest: its name, its file endings, and what opens such a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vibrident.io.columns import ColumnFile


@dataclass(frozen=True)
class Reader:
    """A data format that can be read.

    Attributes:
        name: short name of the format.
        title: what such files are, in a few words.
        endings: of its files, each with its dot, in lower case.
        open: path → the file opened; numbers are converted only when asked for. It raises InputError where the file is
            not what its ending says.
        extra: extra of vibrident, or package, that brings the library it needs; empty: it needs none.
        plain: no native library parses such a file and no links in it are followed, so that it needs no process of its
            own (docs/security.md).
    """

    name: str
    title: str
    endings: tuple[str, ...]
    open: Callable[[Path], ColumnFile]
    extra: str = ""
    plain: bool = False

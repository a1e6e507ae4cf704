"""From the patterns of the command line to calibration files."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from vibrident.errors import InputError

_ENDING = ".toml"


@dataclass(frozen=True, slots=True)
class Named:
    """A file to be identified.

    Attributes:
        path: as it was found from the pattern.
        in_folder: it stands in a folder that was named; where it is no calibration file at all, it is left out.
    """

    path: str
    in_folder: bool


def found(patterns: Sequence[str]) -> list[Named]:
    """The calibration files that the patterns name, each once, pattern by pattern and then by name.

    A file stands for itself, a folder for every ``.toml`` file in it and below it, and a glob for the files and
    folders that match.

    Raises:
        InputError: a pattern names nothing.
    """
    files: dict[str, Named] = {}
    for pattern in patterns:
        before = len(files)
        named = False
        for one in _named(pattern):
            files.setdefault(os.path.abspath(one.path), one)
            named = True
        if len(files) == before and not named:
            raise _nothing(pattern)
    return list(files.values())


def _named(pattern: str) -> Iterator[Named]:
    if os.path.lexists(pattern):
        yield from _of(pattern)
        return
    for match in sorted(glob.iglob(pattern, recursive=True)):
        yield from _of(match)


def _of(path: str) -> Iterator[Named]:
    if not os.path.isdir(path):
        yield Named(path, in_folder=False)
        return
    for folder, below, files in os.walk(path):
        below[:] = sorted(name for name in below if not name.startswith("."))
        for name in sorted(files):
            if name.lower().endswith(_ENDING) and not name.startswith("."):
                yield Named(os.path.join(folder, name), in_folder=True)


def _nothing(pattern: str) -> InputError:
    folder = Path(pattern).is_dir()
    return InputError(
        "No calibration file is there.",
        expected="a calibration file, a folder that holds some, or a glob that matches some",
        found=f"a folder without a {_ENDING} file" if folder else "nothing of that name",
        where=repr(pattern),
        remedy="check the path; quote a glob, so that it comes here as it is",
    )

"""From the patterns of the command line to calibration files."""

from __future__ import annotations

import glob
import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from vibrident.errors import InputError

_ENDING = ".toml"


@dataclass(frozen=True)
class Found:
    """Files to be identified, in order; two columns, because there may be millions.

    Attributes:
        paths: as they were found from the patterns.
        in_folder: 1 for a file found in a named folder, 0 for a file named itself: the former is left out if it is no
            calibration file.
    """

    paths: list[str]
    in_folder: bytearray


def found(patterns: Sequence[str]) -> Found:
    """The calibration files that the patterns name, each once, pattern by pattern and then by name.

    A folder names every ``.toml`` file in it and below it, and a glob the files and folders that match.

    Raises:
        InputError: a pattern names nothing.
    """
    files, seen = Found([], bytearray()), set()
    for pattern in patterns:
        named = False
        for path, in_folder in _named(pattern):
            named = True
            mark = hashlib.blake2b(os.fsencode(os.path.abspath(path)), digest_size=16).digest()
            if mark not in seen:
                seen.add(mark)
                files.paths.append(path)
                files.in_folder.append(in_folder)
        if not named:
            raise _nothing(pattern)
    return files


def _named(pattern: str) -> Iterator[tuple[str, bool]]:
    if os.path.lexists(pattern):
        yield from _of(pattern)
        return
    for match in sorted(glob.iglob(pattern, recursive=True)):
        yield from _of(match)


def _of(path: str) -> Iterator[tuple[str, bool]]:
    if not os.path.isdir(path):
        yield path, False
        return
    for folder, below, files in os.walk(path):
        below[:] = sorted(name for name in below if not name.startswith("."))
        for name in sorted(files):
            if name.lower().endswith(_ENDING) and not name.startswith("."):
                yield os.path.join(folder, name), True


def _nothing(pattern: str) -> InputError:
    folder = Path(pattern).is_dir()
    return InputError(
        "No calibration file is there.",
        expected="a calibration file, a folder that holds some, or a glob that matches some",
        found=f"a folder without a {_ENDING} file" if folder else "nothing of that name",
        where=repr(pattern),
        remedy="check the path; quote a glob, so that the shell does not expand it",
    )

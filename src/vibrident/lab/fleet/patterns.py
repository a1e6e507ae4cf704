"""Calibration files that the patterns of the command line name."""

from __future__ import annotations

import glob
import hashlib
import os
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from vibrident.base.errors import InputError

_ENDING = ".toml"
_BLOCK_PATHS = 256  # compressed together
_MAX_OPENED_BLOCKS = 8


class Paths:
    """Paths in about ten bytes each, because there may be millions.

    They are added, and then read in order.
    """

    def __init__(self) -> None:
        self._blocks: list[bytes] = []
        self._last: list[str] = []  # not compressed yet
        self._opened: dict[int, list[str]] = {}

    def __len__(self) -> int:
        return _BLOCK_PATHS * len(self._blocks) + len(self._last)

    def __getitem__(self, index: int) -> str:
        number, within = divmod(index, _BLOCK_PATHS)
        if number >= len(self._blocks):
            return self._last[within]
        if number not in self._opened:
            if len(self._opened) >= _MAX_OPENED_BLOCKS:
                self._opened.clear()
            self._opened[number] = [
                os.fsdecode(path) for path in zlib.decompress(self._blocks[number]).split(b"\0")
            ]
        return self._opened[number][within]

    def __iter__(self) -> Iterator[str]:
        return (self[index] for index in range(len(self)))

    def add(self, path: str) -> None:
        """Add a path at the end."""
        self._last.append(path)
        if len(self._last) == _BLOCK_PATHS:
            self._blocks.append(zlib.compress(b"\0".join(map(os.fsencode, self._last))))
            self._last = []


@dataclass(frozen=True)
class NamedFiles:
    """Files to be identified, in order; two columns, because there may be millions."""

    paths: Paths  # as they were found from the patterns
    # 1 for a file found in a named folder, 0 for a file named itself: the former is left out if it
    # is no calibration file
    in_folder: bytearray


def find_files(patterns: Sequence[str]) -> NamedFiles:
    """Return the calibration files that the patterns name, each once.

    They come pattern by pattern and then by name. A folder names every ``.toml`` file in it and
    below it, also behind links to folders elsewhere, and a glob the files and folders that match.

    Raises:
        InputError: a pattern names nothing.
    """
    files = NamedFiles(Paths(), bytearray())
    marks = set[bytes]()
    for pattern in patterns:
        matched = False
        for path, in_folder in _files_of_pattern(pattern):
            matched = True
            mark = hashlib.blake2b(os.fsencode(os.path.abspath(path)), digest_size=16).digest()
            if mark not in marks:
                marks.add(mark)
                files.paths.add(path)
                files.in_folder.append(in_folder)
        if not matched:
            raise InputError(
                "No calibration file is there.",
                expected=(
                    "a calibration file, a folder that holds some, or a glob that matches some"
                ),
                found=f"a folder without a {_ENDING} file"
                if os.path.isdir(pattern)
                else "nothing of that name",
                where=repr(pattern),
                remedy="check the path; quote a glob, so that the shell does not expand it",
            )
    return files


def _files_of_pattern(pattern: str) -> Iterator[tuple[str, bool]]:
    for match in (
        [pattern] if os.path.lexists(pattern) else sorted(glob.iglob(pattern, recursive=True))
    ):
        yield from _files_of(match)


def _files_of(path: str) -> Iterator[tuple[str, bool]]:
    if not os.path.isdir(path):
        yield path, False
        return
    roots = [path]
    visited = [os.path.realpath(path)]
    for root in roots:  # links to folders elsewhere are roots too, after the folder that has them
        for folder, below, files in os.walk(root):
            below[:] = sorted(name for name in below if not name.startswith("."))
            for name in sorted(files):
                if name.lower().endswith(_ENDING) and not name.startswith("."):
                    yield os.path.join(folder, name), True
            for link in filter(os.path.islink, (os.path.join(folder, name) for name in below)):
                target = os.path.realpath(link)
                real_folder = os.path.realpath(folder)
                if not _is_within(real_folder, target) and not any(
                    _is_within(target, above) for above in visited
                ):
                    roots.append(link)
                    visited.append(target)


def _is_within(path: str, folder: str) -> bool:
    return os.path.join(path, "").startswith(os.path.join(folder, ""))

"""Limits on reading: a file of a few kilobytes can declare more numbers than any machine holds.

The declared number of values is checked before memory is allocated.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vibrident.base import memory
from vibrident.base.errors import InputError

#: Most columns of a file.
MOST_COLUMNS = 10_000
#: Most characters of a line of text.
LONGEST_LINE = 1 << 18
_NUMBER_BYTES = 8


def require_room(path: Path, numbers: int, number_bytes: int = _NUMBER_BYTES) -> None:
    """Refuse to read more numbers, as declared, than a file of this size may hold.

    Raises:
        InputError: they are too many; or the environment variable of the limit is not a number.
    """
    file_bytes = path.stat().st_size
    most = memory_for(file_bytes)
    needed = max(numbers, 0) * max(number_bytes, _NUMBER_BYTES)
    if needed > most:
        raise InputError(
            "The file declares more numbers than it may hold.",
            expected=f"at most {most / 1e6:.0f} MB of numbers from a file of {file_bytes} bytes",
            found=f"{numbers} numbers, or {needed / 1e6:.0f} MB",
            where=str(path),
            remedy=f"check that the file is whole; if so, set {memory.VARIABLE} to more megabytes",
        )


def memory_for(file_bytes: int) -> float:
    """Most bytes that the numbers of files of this size, together, may take.

    Raises:
        InputError: the environment variable of the limit is not a number.
    """
    try:
        return memory.most_bytes(file_bytes)
    except ValueError as error:
        raise InputError(
            "The limit of memory is not a number.",
            expected=f"{memory.VARIABLE} to be a number of megabytes above 0",
            found=str(error),
            where="environment",
            remedy=f"correct or unset {memory.VARIABLE}",
        ) from error


def require_few(path: Path, columns: Sequence[object], what: str = "columns") -> None:
    """Refuse a file with more than ``MOST_COLUMNS`` columns."""
    if len(columns) > MOST_COLUMNS:
        raise InputError(
            f"The file has too many {what}.",
            expected=f"at most {MOST_COLUMNS}",
            found=str(len(columns)),
            where=str(path),
            remedy="export only the needed ones",
        )

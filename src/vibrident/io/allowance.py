"""What a file may cost: a file of a few kilobytes can declare more numbers than any machine holds.

How many numbers a file declares is looked at before any room is made for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vibrident import memory
from vibrident.errors import InputError
from vibrident.io.columns import unreadable

#: Most columns of a file, and most characters of a line of text.
MOST_COLUMNS = 10_000
LONGEST_LINE = 1 << 18
_NUMBER_BYTES = 8


def require_room(path: Path, numbers: int, number_bytes: int = _NUMBER_BYTES) -> None:
    """Refuse to read more numbers than there is room for.

    Args:
        path: the file; how much it may hold depends on its size.
        numbers: how many will be read, by what the file declares.
        number_bytes: of each, where a library makes something larger than float64 of it.

    Raises:
        InputError: they are too many; or the environment variable that sets the limit holds no number.
    """
    try:
        file_bytes = path.stat().st_size
    except OSError as error:
        raise unreadable(str(path), error, "a data file") from error
    most = memory_for(file_bytes)
    needed = max(numbers, 0) * max(number_bytes, _NUMBER_BYTES)
    if needed > most:
        raise InputError(
            "The file declares more numbers than it may hold.",
            expected=f"at most {most / 1e6:.0f} MB of numbers from a file of {file_bytes} bytes",
            found=f"{numbers} numbers, or {needed / 1e6:.0f} MB",
            where=str(path),
            remedy=f"check that the file is whole; where it is, set {memory.VARIABLE} to more megabytes than that",
        )


def memory_for(file_bytes: int) -> float:
    """Most bytes that the numbers of files of this size, together, may take.

    Raises:
        InputError: the environment variable that sets the limit holds no number.
    """
    try:
        return memory.most_bytes(file_bytes)
    except ValueError as error:
        raise InputError(
            "The limit of memory is no number.",
            expected=f"{memory.VARIABLE} to be a number of megabytes above 0",
            found=str(error),
            where="environment",
            remedy=f"correct or unset {memory.VARIABLE}",
        ) from error


def require_few(path: Path, columns: Sequence[object], what: str = "columns") -> None:
    """Refuse a file of so many columns that nobody can have meant them.

    Raises:
        InputError: there are more than ``MOST_COLUMNS``.
    """
    if len(columns) > MOST_COLUMNS:
        raise InputError(
            f"The file has too many {what}.",
            expected=f"at most {MOST_COLUMNS}",
            found=str(len(columns)),
            where=str(path),
            remedy="export the ones that are needed into a file of their own",
        )

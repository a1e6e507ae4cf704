"""Write files atomically: beside their place, then renamed, so that none is ever partial.

If the power fails, files that the system had not yet written are missing or empty. There is no
fsync: on a busy disk it takes longer than the work.
"""

from __future__ import annotations

import contextlib
import uuid
from collections.abc import Iterator
from pathlib import Path

from vibrident.base.errors import InputError

ENDING = ".part"  # of an unfinished file, whose name begins with a dot


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to; it becomes ``path`` after the block.

    If the block fails, the temporary file is removed.
    """
    partial = path.with_name(f".{uuid.uuid4().hex}{ENDING}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def unwritable(
    error: OSError, where: object, remedy: str = "give another ⟦export.folder⟧, or make room"
) -> InputError:
    """Return the error of an output that cannot be written."""
    if isinstance(error, NotADirectoryError | FileExistsError):
        return InputError(
            "The output folder is a file, or lies below one.",
            expected="a folder, or a name that is free",
            found="a file",
            where=str(where),
            remedy="give another ⟦export.folder⟧",
        )
    return InputError(
        "The output cannot be written.",
        expected="a folder that can be written, with room for the files",
        found=f"{type(error).__name__}: {error.strerror or error}",
        where=str(where),
        remedy=remedy,
    )

"""SHA-256 of data files."""

from __future__ import annotations

import hashlib
from pathlib import Path

from vibrident.io.columns import unreadable


def sha256(path: Path) -> str:
    """Return the hex digest of the file's bytes.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise unreadable(str(path), error, "a data file") from error

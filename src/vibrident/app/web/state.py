"""A user's state on disk, beside the files: what a stopped server left is there again when the next one starts."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

from vibrident.base import parcel

_FILE = "state"
_MOST_BYTES = 20_000_000


def write(folder: Path, state: dict[str, Any]) -> None:
    """Replace what is kept of a user; nothing if the folder is gone."""
    with contextlib.suppress(FileNotFoundError):
        partial = folder / f"{_FILE}.part"
        with os.fdopen(os.open(partial, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600), "wb") as file:
            parcel.send(file, state)
        partial.replace(folder / _FILE)


def read(folder: Path) -> dict[str, Any] | None:
    """What was kept; None if there is nothing, or another version wrote it."""
    try:
        with (folder / _FILE).open("rb") as file:
            found = parcel.receive(file, _MOST_BYTES)
    except (OSError, EOFError, parcel.TooLong, ValueError, TypeError, KeyError, RecursionError, ImportError):
        return None
    return found if isinstance(found, dict) else None

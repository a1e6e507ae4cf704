"""The folder of a running server with all uploads; folders of dead servers are removed."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from pathlib import Path
from typing import Any

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows: without locks a dead server cannot be detected, and leftovers stay
    fcntl = None

PREFIX = "vibrident-serve-"
#: Lock file, held while the server lives; the system releases it however the server ends.
_LOCK = "lock"
_NEW = "vibrident-new-"


class Home:
    """A private folder below the system's temporary folder."""

    def __init__(self) -> None:
        top = Path(tempfile.gettempdir())
        remove_leftovers(top)
        made = Path(tempfile.mkdtemp(prefix=_NEW, dir=top))
        self._lock = os.open(made / _LOCK, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
        if fcntl is not None:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.write(self._lock, f"{os.getpid()}\n".encode())
        self.folder = top / (PREFIX + made.name.removeprefix(_NEW))
        made.rename(self.folder)  # another server sees it only now, locked
        self.spool = self.folder / "spool"
        self.spool.mkdir()

    def close(self) -> None:
        """Remove the folder and all that is in it."""
        shutil.rmtree(self.folder, ignore_errors=True)
        with contextlib.suppress(OSError):
            os.close(self._lock)
        self._lock = -1


def remove_leftovers(top: Path) -> list[str]:
    """Remove the folders of this user's servers that no longer run; returns their names.

    A server holds the lock in its folder while it lives, which identifies it. Links, folders of other users, and
    folders without a lock are left alone.
    """
    if fcntl is None:
        return []
    removed = []
    try:
        names = [name for name in os.listdir(top) if name.startswith(PREFIX)]
        above = os.open(top, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return []
    try:
        for name in names:
            with contextlib.suppress(OSError):
                if _remove(name, above):
                    removed.append(name)
    finally:
        os.close(above)
    return removed


def _remove(name: str, above: int) -> bool:
    folder = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=above)
    try:
        if os.fstat(folder).st_uid != os.getuid():
            return False
        lock = os.open(_LOCK, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
    finally:
        os.close(folder)
    try:
        if not stat.S_ISREG(os.fstat(lock).st_mode):
            return False
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # BlockingIOError: its server lives
        shutil.rmtree(name, dir_fd=above)  # follows no links
    finally:
        os.close(lock)
    return True

"""Own the folder of a running server: kept for the next server at its address, or removed."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import tempfile
import time
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows: without locks a dead server cannot be detected, and leftovers stay
    fcntl = None

PREFIX = "vibrident-serve-"
# lock file, held while the server lives; the system releases it however the server ends
_LOCK = "lock"
_NEW = "vibrident-new-"


class ServerFolder:
    """A private folder: temporary, or in ``state_folder`` and named by the server's address.

    Folders of dead servers are kept for ``keep_s`` seconds.
    """

    def __init__(
        self, state_folder: Path | None = None, address: str = "", keep_s: float = 0.0
    ) -> None:
        self.is_kept = state_folder is not None
        remove_leftovers(Path(tempfile.gettempdir()))
        if state_folder is None:
            top = Path(tempfile.gettempdir())
            new_folder = Path(tempfile.mkdtemp(prefix=_NEW, dir=top))
            self._take(new_folder)
            self.folder = top / (PREFIX + new_folder.name.removeprefix(_NEW))
            new_folder.rename(self.folder)  # another server sees it only now, locked
        else:
            self.folder = state_folder / (PREFIX + re.sub(r"[^\w.-]", "_", address))
            try:
                self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                self._take(self.folder)
            except OSError as error:
                raise InputError(
                    "The folder in which the page keeps its state cannot be used.",
                    expected="a folder that this user may write and no other server uses",
                    found=error.strerror or str(error),
                    where=str(self.folder),
                    remedy="stop the other server, choose another ⟦serve.port⟧, or keep nothing "
                    "with ⟦serve.keep = 0⟧",
                ) from error
            remove_leftovers(state_folder, keep_s)
        self.spool = self.folder / "spool"
        shutil.rmtree(self.spool, ignore_errors=True)
        self.spool.mkdir()

    def _take(self, folder: Path) -> None:
        self._lock = os.open(
            folder / _LOCK, os.O_CREAT | os.O_RDWR | getattr(os, "O_NOFOLLOW", 0), 0o600
        )
        if fcntl is not None:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.truncate(self._lock, 0)
        os.write(self._lock, f"{os.getpid()}\n".encode())

    def close(self) -> None:
        """Remove what is not kept."""
        if self._lock < 0:
            return
        if self.is_kept:
            os.utime(self._lock)  # kept from now on
        shutil.rmtree(self.spool if self.is_kept else self.folder, ignore_errors=True)
        with contextlib.suppress(OSError):
            os.close(self._lock)
        self._lock = -1


def remove_leftovers(top: Path, older_s: float = 0.0) -> list[str]:
    """Remove folders of this user's servers that stopped ``older_s`` ago or more; return names.

    A server holds the lock in its folder while it lives, which identifies it. Links, folders of
    other users, and folders without a lock are left alone.
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
                if _remove(name, above, older_s):
                    removed.append(name)
    finally:
        os.close(above)
    return removed


def _remove(name: str, above: int, older_s: float) -> bool:
    folder = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=above)
    try:
        if os.fstat(folder).st_uid != os.getuid():
            return False
        lock = os.open(_LOCK, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
        used = max(os.fstat(folder).st_mtime, os.fstat(lock).st_mtime)
    finally:
        os.close(folder)
    try:
        if not stat.S_ISREG(os.fstat(lock).st_mode) or (older_s and time.time() - used < older_s):
            return False
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # BlockingIOError: its server lives
        shutil.rmtree(name, dir_fd=above)  # follows no links
    finally:
        os.close(lock)
    return True

"""Keep the users of the page for a time after they left, within the limits of the server."""

from __future__ import annotations

import asyncio
import gc
import os
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from vibrident.app.web.authentication import Authenticator
from vibrident.app.web.column_guess import prepare
from vibrident.app.web.confinement import confinement_command
from vibrident.app.web.laboratories import Laboratories
from vibrident.app.web.session import MEGABYTE
from vibrident.app.web.user import User
from vibrident.base.errors import InputError
from vibrident.base.process import Limits
from vibrident.base.sandbox import WarmProcess, run

#: Time for which a page without a browser is kept by a server that keeps nothing on disk, s.
MAX_IDLE_S = 3600.0
_WRITE_S = 0.3  # seconds between two rounds that write what has changed
# most users; beyond, the one who left first is evicted; if nobody has left, a new one is refused
MAX_USERS = 50
_ALL_LIMITS = 10  # limit of all users, in limits of one
# processes that read files: how many, and how long one may take
_MAX_SANDBOXES = 3
_MAX_SANDBOX_S = 60.0
# its bytes, and more for each byte that a user may upload
_SANDBOX_MEMORY_BYTES = 1_000_000_000
_SANDBOX_BYTES_PER_UPLOADED_BYTE = 5
_ROUND_S = 20.0
_T = TypeVar("_T")


class Users:
    """All users of a server, their files in a folder; ``limit_mb`` holds for those of one user.

    ``store``: URL of the history that all of them share. ``keep_s``: seconds for which the state of
    who left is kept on disk, also when the server stops; 0 for an hour, as long as the server runs.
    ``door``: of a team's page, where the owner of a page is an account. ``key``: file and pass
    phrase of the key that certificates are signed with. ``laboratories``: folder of the profiles
    that all of them share; None for one in ``folder``.
    """

    def __init__(
        self,
        folder: Path,
        limit_mb: float,
        store: str | None = None,
        keep_s: float = 0.0,
        door: Authenticator | None = None,
        key: tuple[Path, str] | None = None,
        laboratories: Path | None = None,
    ) -> None:
        self.key = key
        self.laboratories = Laboratories(laboratories or folder / "laboratories")
        self.folder = folder
        self.limit_mb = limit_mb
        self.store = store
        self.keep_s = keep_s
        self.door = door
        self.members: list[User] = []
        self.to_write: set[User] = set()
        self.identifying = asyncio.Semaphore(max(2, os.cpu_count() or 1))
        self._ready = WarmProcess(prepare, confinement_command(folder))
        self._threads = ThreadPoolExecutor(_MAX_SANDBOXES, thread_name_prefix="look")
        self._round: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Restore kept users, prepare the first process, begin to remove absent users."""
        if self.keep_s:
            self._restore()
        self._threads.submit(self._ready.prepare)
        gc.collect()
        gc.freeze()  # libraries stay: collecting them again and again would delay all users
        self._round = asyncio.create_task(self._rounds())

    def _restore(self) -> None:
        for folder in self.folder.iterdir():
            if folder.is_dir() and len(folder.name) == 32:
                user = User.restored(self, folder)
                if user is None:
                    shutil.rmtree(folder, ignore_errors=True)
                else:
                    self.members.append(user)
        self.remove_absent()

    def close(self) -> None:
        """End everything; the kept state stays on disk."""
        if self._round is not None:
            self._round.cancel()
        for user in self.members:
            if self.keep_s:
                user.write()  # before the running identification ends: the next server tells of it
                user.cancel()
            else:
                user.close()
        self.members.clear()
        self._ready.close()
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def run_sandboxed(
        self, function: Callable[..., _T], *args: Any, file_bytes: int = 0
    ) -> _T:
        """Run a function of ``sandboxed`` in a separate process, within limits."""
        memory = int(
            _SANDBOX_MEMORY_BYTES + _SANDBOX_BYTES_PER_UPLOADED_BYTE * self.limit_mb * MEGABYTE
        )
        # what writes needs more than the folder of the files
        apart = run if file_bytes else self._ready.run
        call = partial(
            apart, function, *args, limits=Limits(_MAX_SANDBOX_S, memory, file_bytes, memory)
        )
        return await asyncio.get_running_loop().run_in_executor(self._threads, call)

    def attach(self, client: Any, owner: str = "") -> User:
        """Return the user of a tab of this owner's browser: the earlier one, or a new one."""
        user = next(
            (
                candidate
                for candidate in self.members
                if (candidate.tab, candidate.owner) == (client.tab_id, owner)
            ),
            None,
        )
        user = user or self._new(client.tab_id, owner)
        user.client = client
        user.last_seen_s = time.time()
        return user

    def closed_tabs_of(self, owner: str) -> list[User]:
        """Return the users of this owner's closed tabs, the latest first."""
        mine = [
            user
            for user in self.members
            if owner and user.owner == owner and not (user.connected or user.empty)
        ]
        return sorted(mine, key=lambda user: -user.last_seen_s)

    def hand_over(self, closed: User, user: User) -> bool:
        """Give a tab the state of a closed one; return whether that still exists.

        The tab's own state is kept in exchange.
        """
        if closed not in self.closed_tabs_of(user.owner):
            return False
        tab = closed.tab
        closed.tab = user.tab
        user.tab = tab
        for exchanged in (closed, user):
            exchanged.changed()
        return True

    def _new(self, tab: str, owner: str) -> User:
        self.remove_absent()
        while len(self.members) >= MAX_USERS:
            if not self._drop_oldest():
                raise InputError(
                    "The server has reached its limit of users.",
                    expected=f"at most {MAX_USERS} at once",
                    found="as many",
                    remedy="reload the page later, or start a server on a machine of your own",
                )
        self.members.append(user := User(self, owner, tab))
        return user

    def make_room(self, size: int) -> None:
        """Evict absent users, the earliest first, until so many bytes fit.

        InputError if they still do not fit.
        """
        most = _ALL_LIMITS * self.limit_mb * MEGABYTE
        while sum(user.session.used_bytes for user in self.members) + size > most:
            if not self._drop_oldest():
                raise InputError(
                    "The server has no room for more files at present.",
                    expected=f"at most {_ALL_LIMITS * self.limit_mb:g} MB of all users together",
                    found="more",
                    where="upload",
                    remedy="try again later, or start a server on a machine of your own",
                )

    def remove_absent(self) -> None:
        """Remove users who did not return."""
        now = time.time()
        for user in list(self.members):
            if user.connected or user.busy:
                user.last_seen_s = now
            elif now - user.last_seen_s > (_ROUND_S if user.empty else self.keep_s or MAX_IDLE_S):
                self._drop(user)

    def _drop_oldest(self) -> bool:
        gone = [user for user in self.members if not (user.connected or user.busy)]
        if gone:
            self._drop(min(gone, key=lambda user: user.last_seen_s))
        return bool(gone)

    def _drop(self, user: User) -> None:
        self.members.remove(user)
        user.close()

    async def _rounds(self) -> None:
        last = time.monotonic()
        while True:
            await asyncio.sleep(_WRITE_S)
            if time.monotonic() - last > _ROUND_S:
                last = time.monotonic()
                self.remove_absent()
                self.to_write |= {
                    user for user in self.members if user.connected and not user.empty
                }
            while self.keep_s and self.to_write:
                self.to_write.pop().write()

"""The users of the page: their state, kept for a time after they left, and limits of all users."""

from __future__ import annotations

import asyncio
import gc
import hashlib
import os
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from vibrident.app.web.confinement import confined
from vibrident.app.web.door import Door
from vibrident.app.web.form.description import calibration_text
from vibrident.app.web.held import Choices, Confirmed, Form, Job, Named, read_state, write_state
from vibrident.app.web.laboratories import Laboratories
from vibrident.app.web.language import phrase
from vibrident.app.web.looks import facts, prepare
from vibrident.app.web.session import MEGABYTE, RESULT, Session
from vibrident.app.web.task_run import TaskRun
from vibrident.app.web.worker import Stopped, Worker, identify
from vibrident.base.errors import InputError
from vibrident.base.process import Limits
from vibrident.base.sandbox import WarmProcess, run

KEPT_S = 3600.0  # seconds for which a page's state is kept without a browser, by a server that keeps nothing on disk
_WRITE_S = 0.3  # seconds between two rounds that write what has changed
MOST_USERS = 50  # most users; beyond, the one who left first is evicted; if nobody has left, a new one is refused
_ALL_LIMITS = 10  # limit of all users, in limits of one
_LOOKS_AT_ONCE, _LOOK_SECONDS = 3, 60.0  # processes that read files: how many, and how long one may take
_LOOK_MEMORY, _LOOK_MEMORY_A_BYTE = 1_000_000_000, 5  # its bytes, and more for each byte that a user may upload
_ROUND_S = 20.0
_T = TypeVar("_T")


class User:
    """State of one open page; not shared with other pages."""

    def __init__(self, users: Users, owner: str = "", tab: str = "", kept: str = "") -> None:
        self.users, self.owner, self.tab = users, owner, tab
        self.look = users.look
        self.session = Session(users.folder, users.limit_mb, users.make_room, kept)
        self.worker, self.task = Worker(), TaskRun(self)
        self.results: list[Named] = []
        self.form: Form | None = None
        self.confirmed: Confirmed | None = None
        self.profile = ""  # of the laboratory, by name; empty for none
        self.job: Job | None = None
        self.notice = ""
        self.client: Any = None
        self.seen = time.time()
        self.running: Choices | None = None  # under way, or broken off and not repeated
        self.stopped: InputError | None = None  # why it was broken off

    @classmethod
    def restored(cls, users: Users, folder: Path) -> User | None:
        """Who left this folder; None if nobody can tell."""
        known = read_state(folder)
        if known is None:
            return None
        try:
            user = cls(users, known["owner"], known["tab"], folder.name)
            user.session.restore(known["session"])
            user.form, user.confirmed, user.seen = known["form"], known["confirmed"], known["seen"]
            user.profile = known["profile"]
            user.results = [named for named in known["results"] if named.path.exists()]
            if user.form is not None:
                user.form.touched = set(user.form.touched)
            if known["running"] is not None:
                user.running = known["running"]
                user.stopped = Stopped(**known["stopped"]) if known["stopped"] else _stopped("the identification")
                user.job = Job("", over=True, error=user.stopped, choices=user.running)
            user.task.restore(known["task"], _stopped("the task"))
        except (KeyError, TypeError, ValueError, AttributeError, OSError):
            return None
        return user

    def changed(self) -> None:
        """Something is to be kept: it is written soon."""
        self.users.to_write.add(self)

    def write(self) -> None:
        """Write the state beside the files."""
        form = self.form
        if form is not None:  # the chart can be drawn again
            form = replace(form, guess=replace(form.guess, chart=b""), touched=sorted(form.touched))  # type: ignore[arg-type]
        kept = ("owner", "tab", "seen", "confirmed", "profile", "results", "running")
        state = {**{name: getattr(self, name) for name in kept}, "session": self.session.state, "form": form}
        state["task"] = self.task.state
        state["stopped"] = dict(vars(self.stopped)) if self.stopped else None
        write_state(self.session.folder, state)

    @property
    def connected(self) -> bool:
        """Whether a browser is connected."""
        return self.client is not None and bool(self.client.has_socket_connection)

    @property
    def busy(self) -> bool:
        """Whether an identification is under way."""
        return self.job is not None and not self.job.over

    @property
    def empty(self) -> bool:
        """Whether there is nothing to lose."""
        return not (self.session.names or self.results or self.busy or self.task.busy)

    @property
    def asked(self) -> Form | None:
        """Return the form, where it describes the data; None where a calibration file came with them."""
        own = any(name.lower().endswith(".toml") for name in self.session.names)
        return None if own else self.form

    def may(self, role: str) -> bool:
        """Whether who has this page may do what the role does."""
        door = self.users.door
        account = door.account(self.owner) if door else None
        return door is None or (account is not None and account.may(role))

    def require(self, role: str, what: str) -> None:
        """Refuse what the account may not do."""
        if not self.may(role):
            raise InputError(
                f"Your account may not {what}.",
                expected=f"an account with the role “{role}”",
                found=repr(self.owner),
                remedy="ask whoever runs the server",
            )

    async def note(self, action: str, path: Path | None = None, **facts: Any) -> None:
        """Write to the audit log who did what, with the SHA-256 of a result's file."""
        if (door := self.users.door) is None:
            return

        def write() -> None:
            more = {} if path is None else {"sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
            door.note(self.owner, action, **facts, **more)

        await asyncio.to_thread(write)

    def write_form(self) -> None:
        """Write the calibration file that the form describes, if that is what was confirmed."""
        if self.confirmed and self.confirmed.from_form and self.form:
            self.session.write_calibration(calibration_text(self.form.given, self.session.files))

    def start(self, choices: Choices, *, again: bool = False) -> None:
        """Begin to identify with a copy of the data, if the account may; the outcome is in ``job`` and ``results``.

        ``again``: with the calibration file of the last identification, whatever the form says since.
        """
        self.require("identify", "identify")
        if not again:
            self.session.keep_ran(choices.calibration)
        self.job, self.running, self.stopped = Job(choices=choices), choices, None
        self.changed()
        self._task = asyncio.get_running_loop().create_task(self._identify(self.job, choices))

    async def _identify(self, job: Job, choices: Choices) -> None:
        try:
            async with self.session.new_folder("run") as copy:
                made = copy / f"new-{RESULT}"
                await asyncio.to_thread(self.session.copy_to, copy)
                self.session.take_ran(copy, choices.calibration)
                if self.users.identifying.locked():
                    job.words = phrase("Waiting for other identifications …")
                async with self.users.identifying:
                    job.words = Job.BEGINNING
                    task = (identify, choices.calibration, choices.options, made)
                    await self.worker.run(*task, folder=copy, progress=job.add)
                job.words = phrase("Reading the result …")
                model, estimator = await self.look(facts, made)
                await self.note("identified", made, model=model, estimator=estimator)
                taken = [named.name.partition(":")[0] for named in self.results]
                number = max((int(number) for number in taken if number.isdecimal()), default=0) + 1
                self.keep(f"{number}: {model}, {estimator}", made, copy / choices.calibration, choices)
                job.words = Job.DONE
        except asyncio.CancelledError:
            job.words = phrase("Cancelled.")
        except Exception as error:
            job.words, job.error = "", error
        finally:
            self.stopped = job.error if isinstance(job.error, Stopped) else None
            job.over, self.running = True, choices if self.stopped else None
            self.changed()

    def keep(self, name: str, place: Path, calibration: Path | None = None, choices: Choices | None = None) -> None:
        """Keep a result under a free name; evict the oldest beyond the limit."""
        path, gone = self.session.keep_result(place, calibration)
        taken = {named.name for named in self.results}
        others = (f"{name} {number}" for number in range(2, len(taken) + 3))
        free = next(other for other in (name, *others) if other not in taken)
        self.results.append(Named(free, path, choices))
        lost = [named.name for named in self.results if named.path in gone]
        self.results = [named for named in self.results if named.path not in gone]
        if lost:
            names = ", ".join(f"“{name}”" for name in lost)
            self.notice = phrase("Too many results; removed: {names}.", names=names)
        self.changed()

    def close(self) -> None:
        """End running processes, remove the files."""
        self.worker.cancel()
        self.task.worker.cancel()
        self.session.close()
        self.users.to_write.discard(self)
        self.results, self.form, self.confirmed, self.notice = [], None, None, ""


def _stopped(during: str) -> Stopped:
    return Stopped(
        f"The server was stopped during {during}.",
        expected="a computation that runs to its end",
        found="a server that was started again",
        remedy="repeat it; the data and the form are here",
    )


class Users:
    """All users of a server, their files in a folder; ``limit_mb`` holds for those of one user.

    ``store``: URL of the history that all of them share. ``keep_s``: seconds for which the state of who left is kept on
    disk, also when the server stops; 0 for an hour, as long as the server runs. ``door``: of a team's page, where the
    owner of a page is an account. ``key``: file and pass phrase of the key that certificates are signed with.
    ``laboratories``: folder of the profiles that all of them share; None for one in ``folder``.
    """

    def __init__(
        self,
        folder: Path,
        limit_mb: float,
        store: str | None = None,
        keep_s: float = 0.0,
        door: Door | None = None,
        key: tuple[Path, str] | None = None,
        laboratories: Path | None = None,
    ) -> None:
        self.key = key
        self.laboratories = Laboratories(laboratories or folder / "laboratories")
        self.folder, self.limit_mb, self.store, self.keep_s, self.door = folder, limit_mb, store, keep_s, door
        self.kept: list[User] = []
        self.to_write: set[User] = set()
        self.identifying = asyncio.Semaphore(max(2, os.cpu_count() or 1))
        self._ready = WarmProcess(prepare, confined(folder))
        self._threads = ThreadPoolExecutor(_LOOKS_AT_ONCE, thread_name_prefix="look")
        self._round: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Take up what was kept, prepare the first process, begin to remove absent users."""
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
                    self.kept.append(user)
        self.forget()

    def close(self) -> None:
        """End everything; what is kept stays on disk."""
        if self._round is not None:
            self._round.cancel()
        for user in self.kept:
            if self.keep_s:
                user.write()  # before the running identification ends: the next server tells of it
                user.worker.cancel()
                user.task.worker.cancel()
            else:
                user.close()
        self.kept.clear()
        self._ready.close()
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def look(self, function: Callable[..., _T], *args: Any, file_bytes: int = 0) -> _T:
        """Run a function of ``looks`` in a separate process, within limits."""
        memory = int(_LOOK_MEMORY + _LOOK_MEMORY_A_BYTE * self.limit_mb * MEGABYTE)
        apart = run if file_bytes else self._ready.run  # what writes needs more than the folder of the files
        call = partial(apart, function, *args, limits=Limits(_LOOK_SECONDS, memory, file_bytes, memory))
        return await asyncio.get_running_loop().run_in_executor(self._threads, call)

    def attach(self, client: Any, owner: str = "") -> User:
        """The user of the tab in which a page was opened, in a browser of this owner: the one it had, or a new one."""
        user = next((one for one in self.kept if (one.tab, one.owner) == (client.tab_id, owner)), None)
        user = user or self._new(client.tab_id, owner)
        user.client, user.seen = client, time.time()
        return user

    def left_by(self, owner: str) -> list[User]:
        """What this owner left in tabs that are closed, the latest first."""
        mine = [user for user in self.kept if owner and user.owner == owner and not (user.connected or user.empty)]
        return sorted(mine, key=lambda user: -user.seen)

    def hand_over(self, left: User, user: User) -> bool:
        """Give a tab what its owner left; whether it still is there. What the tab had is kept with those left."""
        if left not in self.left_by(user.owner):
            return False
        left.tab, user.tab = user.tab, left.tab
        for one in (left, user):
            one.changed()
        return True

    def _new(self, tab: str, owner: str) -> User:
        self.forget()
        while len(self.kept) >= MOST_USERS:
            if not self._drop_oldest():
                raise InputError(
                    "The server has reached its limit of users.",
                    expected=f"at most {MOST_USERS} at once",
                    found="as many",
                    remedy="reload the page later, or start a server on a machine of your own",
                )
        self.kept.append(user := User(self, owner, tab))
        return user

    def make_room(self, size: int) -> None:
        """Evict users who have left, the earliest first, until so many bytes fit; refuse those that do not."""
        most = _ALL_LIMITS * self.limit_mb * MEGABYTE
        while sum(user.session.used_bytes for user in self.kept) + size > most:
            if not self._drop_oldest():
                raise InputError(
                    "The server has no room for more files at present.",
                    expected=f"at most {_ALL_LIMITS * self.limit_mb:g} MB of all users together",
                    found="more",
                    where="upload",
                    remedy="try again later, or start a server on a machine of your own",
                )

    def forget(self) -> None:
        """Remove users who did not return."""
        now = time.time()
        for user in list(self.kept):
            if user.connected or user.busy or user.task.busy:
                user.seen = now
            elif now - user.seen > (_ROUND_S if user.empty else self.keep_s or KEPT_S):
                self._drop(user)

    def _drop_oldest(self) -> bool:
        gone = [user for user in self.kept if not (user.connected or user.busy or user.task.busy)]
        if gone:
            self._drop(min(gone, key=lambda user: user.seen))
        return bool(gone)

    def _drop(self, user: User) -> None:
        self.kept.remove(user)
        user.close()

    async def _rounds(self) -> None:
        last = time.monotonic()
        while True:
            await asyncio.sleep(_WRITE_S)
            if time.monotonic() - last > _ROUND_S:
                last = time.monotonic()
                self.forget()
                self.to_write |= {user for user in self.kept if user.connected and not user.empty}
            while self.keep_s and self.to_write:
                self.to_write.pop().write()

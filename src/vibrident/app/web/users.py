"""The users of the page: their state, kept for an hour after they left, and limits of all users."""

from __future__ import annotations

import asyncio
import gc
import os
import secrets
import shutil
import time
from collections.abc import Callable, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from vibrident.app.web.description import Description
from vibrident.app.web.looks import Guess, facts, prepare
from vibrident.app.web.session import MEGABYTE, RESULT, Session
from vibrident.app.web.worker import Worker, identify
from vibrident.app.workflow.estimators import AUTO, estimators_with
from vibrident.base.errors import InputError
from vibrident.base.process import Limits
from vibrident.base.sandbox import Ready

#: Seconds for which a page's state is kept without a browser.
KEPT_S = 3600.0
#: Most users; beyond, the one who left first is evicted; if nobody has left, a new one is refused.
MOST_USERS = 50
#: Limit of all users, in limits of one.
_ALL_LIMITS = 10
#: Most processes that read files at once.
_LOOKS_AT_ONCE = 3
_LOOK_SECONDS = 60.0
#: Memory of a reading process, bytes.
_LOOK_MEMORY = 1_000_000_000
#: Further memory for each byte that a user may upload.
_LOOK_MEMORY_A_BYTE = 5
_ROUND_S = 20.0
_KEY = "user"
_T = TypeVar("_T")


@dataclass(frozen=True)
class Choices:
    """Choices of one identification, also as a command for a shell.

    Attributes:
        calibration: name of the calibration file, in the folder of the data.
        estimator: its name.
        discretisation: of an estimator that has one; ignored for others.
        uncertainty: what the uncertainties cover.
    """

    calibration: str
    estimator: str = AUTO
    discretisation: str = "bandlimited"
    uncertainty: str = "auto"

    @property
    def options(self) -> dict[str, str]:
        """Every applicable option, including those at their default."""
        own = {"discretisation": self.discretisation} if self.estimator in estimators_with("discretisation") else {}
        return {"estimator": self.estimator, **own, "uncertainty": self.uncertainty}

    @property
    def command(self) -> str:
        """For a shell, in the folder of the data; file names are safe within double quotes."""
        file = f'"{self.calibration}"' if " " in self.calibration else self.calibration
        return " ".join(("vibrident identify", file, *(f"--{key} {value}" for key, value in self.options.items())))


@dataclass
class Named:
    """A result and its name; if made here, with its choices."""

    name: str
    path: Path
    choices: Choices | None = None

    @property
    def calibration(self) -> Path:
        """The calibration file of a result that was made here."""
        return self.path.with_suffix(".toml")


@dataclass
class Form:
    """The form about the columns, and the user's input.

    Attributes:
        guess: the choices, and the possible meaning of the columns.
        given: the form's values.
        touched: fields set by the user; a guess does not change them.
    """

    guess: Guess
    given: Description
    touched: set[str] = field(default_factory=set)

    def get(self, name: str) -> Any:
        """Value of a field; those of the sensor are named ``sensor.NAME``."""
        whole, _, part = name.partition(".")
        return getattr(self.given, whole)[part] if part else getattr(self.given, whole)

    def set(self, name: str, value: Any) -> None:
        """Set a field to the user's value."""
        self.touched.add(name)
        whole, _, part = name.partition(".")
        if part:
            getattr(self.given, whole)[part] = value
        else:
            setattr(self.given, whole, value)


@dataclass
class Confirmed:
    """The calibration file that identifications use: the uploaded one, or the form's."""

    name: str
    from_form: bool


@dataclass
class Job:
    """A running identification: its status, the cost of each start, and how it ended."""

    BEGINNING: ClassVar[str] = "Reading the data, loading the libraries …"
    DONE: ClassVar[str] = "Identified."

    words: str = BEGINNING
    starts: list[list[float]] = field(default_factory=list)
    over: bool = False
    error: Exception | None = None
    began: float = field(default_factory=time.monotonic)

    @property
    def status(self) -> str:
        """The status, with the elapsed seconds."""
        return self.words if self.over else f"{self.words} ({time.monotonic() - self.began:.0f} s)"

    def add(self, iteration: int, most: int, cost: float) -> None:
        """Record an iteration; if the count does not increase, another start has begun."""
        if not self.starts or iteration <= len(self.starts[-1]):
            self.starts.append([])
        self.starts[-1].append(cost)
        which = f"Start {len(self.starts)}, iteration" if len(self.starts) > 1 else "Iteration"
        self.words = f"{which} {iteration} of at most {most}, cost {cost:.4g}"


class User:
    """State of one open page; not shared with other pages."""

    def __init__(self, users: Users) -> None:
        self.users = users
        self.look = users.look
        self.session = Session(users.folder, users.limit_mb, users.make_room)
        self.worker = Worker()
        self.results: list[Named] = []
        self.form: Form | None = None
        self.confirmed: Confirmed | None = None
        self.job: Job | None = None
        self.notice = ""
        self.client: Any = None
        self.seen = time.monotonic()

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
        return not (self.session.names or self.results or self.busy)

    def start(self, choices: Choices) -> None:
        """Begin to identify with a copy of the data; the outcome is in ``job`` and ``results``."""
        self.job = Job()
        self._task = asyncio.get_running_loop().create_task(self._identify(self.job, choices))

    async def _identify(self, job: Job, choices: Choices) -> None:
        copy = self.session.new_folder("run")
        made = copy / f"new-{RESULT}"
        try:
            await asyncio.to_thread(self.session.copy_to, copy)
            if self.users.identifying.locked():
                job.words = "Waiting for other identifications …"
            async with self.users.identifying:
                job.words = Job.BEGINNING
                task = (identify, choices.calibration, choices.options, made)
                await self.worker.run(*task, folder=copy, progress=job.add)
            job.words = "Reading the result …"
            model, estimator = await self.look(facts, made)
            self.keep(f"{self._number()}: {model}, {estimator}", made, copy / choices.calibration, choices)
            job.words = Job.DONE
        except asyncio.CancelledError:
            job.words = "Cancelled."
        except Exception as error:
            job.words, job.error = "", error
        finally:
            job.over = True
            shutil.rmtree(copy, ignore_errors=True)

    def _number(self) -> int:
        taken = [named.name.partition(":")[0] for named in self.results]
        return max((int(number) for number in taken if number.isdecimal()), default=0) + 1

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
            self.notice = f"Too many results; removed: {names}."

    def close(self) -> None:
        """End running processes, remove the files."""
        self.worker.cancel()
        self.session.close()
        self.results, self.form, self.confirmed, self.notice = [], None, None, ""


class Users:
    """All users of a server.

    Args:
        folder: folder of their files.
        limit_mb: most megabytes of one user's files.
        store: URL of the history that all of them share; None for none.
    """

    def __init__(self, folder: Path, limit_mb: float, store: str | None = None) -> None:
        self.folder, self.limit_mb, self.store = folder, limit_mb, store
        self.kept: dict[str, User] = {}
        self.identifying = asyncio.Semaphore(max(2, os.cpu_count() or 1))
        self._ready = Ready(prepare)
        self._threads = ThreadPoolExecutor(_LOOKS_AT_ONCE, thread_name_prefix="look")
        self._round: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Prepare the first process, begin to remove absent users."""
        self._threads.submit(self._ready.prepare)
        gc.collect()
        gc.freeze()  # libraries stay: collecting them again and again would delay all users
        self._round = asyncio.create_task(self._rounds())

    def close(self) -> None:
        """End everything."""
        if self._round is not None:
            self._round.cancel()
        for user in self.kept.values():
            user.close()
        self.kept.clear()
        self._ready.close()
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def look(self, function: Callable[..., _T], *args: Any, file_bytes: int = 0) -> _T:
        """Run a function of ``looks`` in a separate process, within limits."""
        memory = int(_LOOK_MEMORY + _LOOK_MEMORY_A_BYTE * self.limit_mb * MEGABYTE)
        call = partial(self._ready.run, function, *args, limits=Limits(_LOOK_SECONDS, memory, file_bytes, memory))
        return await asyncio.get_running_loop().run_in_executor(self._threads, call)

    def attach(self, client: Any, tab: MutableMapping[str, Any]) -> User:
        """The user of this browser tab: the one it had, or a new one.

        Args:
            client: the page that was opened.
            tab: the server's storage of the tab; a copy if the tab was duplicated.

        Raises:
            InputError: there are too many users.
        """
        user = self.kept.get(tab.get(_KEY, ""))
        if user is None or (user.connected and user.client is not client and user.client.tab_id != client.tab_id):
            user = self._new(tab)
        user.client, user.seen = client, time.monotonic()
        return user

    def _new(self, tab: MutableMapping[str, Any]) -> User:
        self.forget()
        while len(self.kept) >= MOST_USERS:
            if not self._drop_oldest():
                raise InputError(
                    "The server has reached its limit of users.",
                    expected=f"at most {MOST_USERS} at once",
                    found="as many",
                    remedy="reload the page later, or start a server on a machine of your own",
                )
        tab[_KEY] = secrets.token_hex(16)
        user = self.kept[tab[_KEY]] = User(self)
        return user

    def make_room(self, size: int) -> None:
        """Evict users who have left, the earliest first, until so many bytes fit.

        Raises:
            InputError: they do not fit.
        """
        most = _ALL_LIMITS * self.limit_mb * MEGABYTE
        while sum(user.session.used_bytes for user in self.kept.values()) + size > most:
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
        now = time.monotonic()
        for key, user in list(self.kept.items()):
            if user.connected or user.busy:
                user.seen = now
            elif now - user.seen > (_ROUND_S if user.empty else KEPT_S):
                self._drop(key)

    def _drop_oldest(self) -> bool:
        gone = [(user.seen, key) for key, user in self.kept.items() if not (user.connected or user.busy)]
        if gone:
            self._drop(min(gone)[1])
        return bool(gone)

    def _drop(self, key: str) -> None:
        self.kept.pop(key).close()

    async def _rounds(self) -> None:
        while True:
            await asyncio.sleep(_ROUND_S)
            self.forget()

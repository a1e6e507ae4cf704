"""Define one user of the page: files, form, results, and the work that is under way."""

from __future__ import annotations

import asyncio
import hashlib
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from vibrident.app.web.form.description import calibration_text
from vibrident.app.web.language import phrase
from vibrident.app.web.sandboxed import model_and_estimator
from vibrident.app.web.session import RESULT, PageSession
from vibrident.app.web.state import (
    Choices,
    ConfirmedCalibration,
    Form,
    Job,
    NamedResult,
    read_state,
    write_state,
)
from vibrident.app.web.task_run import TaskRun
from vibrident.app.web.worker import StoppedError, Worker, identify
from vibrident.base.errors import InputError


class User:
    """State of one open page; not shared with other pages. ``users``: all of the server."""

    def __init__(self, users: Any, owner: str = "", tab: str = "", folder_name: str = "") -> None:
        self.users = users
        self.owner = owner
        self.tab = tab
        self.run_sandboxed = users.run_sandboxed
        self.session = PageSession(users.folder, users.limit_mb, users.make_room, folder_name)
        self.task = TaskRun(self)
        self.worker = Worker()
        self.results: list[NamedResult] = []
        self.form: Form | None = None
        self.confirmed: ConfirmedCalibration | None = None
        self.profile = ""  # of the laboratory, by name; empty for none
        self.job: Job | None = None
        self.notice = ""
        self.client: Any = None
        self.seen = time.time()
        self.running: Choices | None = None  # under way, or broken off and not repeated
        self.stopped: InputError | None = None  # why it was broken off

    @classmethod
    def restored(cls, users: Any, folder: Path) -> User | None:
        """Restore the user of a kept folder, or None if unreadable."""
        state = read_state(folder)
        if state is None:
            return None
        try:
            user = cls(users, state["owner"], state["tab"], folder.name)
            user.session.restore(state["session"])
            user.form = state["form"]
            user.confirmed = state["confirmed"]
            user.seen = state["seen"]
            user.profile = state["profile"]
            user.results = [named for named in state["results"] if named.path.exists()]
            if user.form is not None:
                user.form.touched = set(user.form.touched)
            if state["running"] is not None:
                user.running = state["running"]
                user.stopped = (
                    StoppedError(**state["stopped"])
                    if state["stopped"]
                    else _stopped_error("the identification")
                )
                user.job = Job("", over=True, error=user.stopped, choices=user.running)
            user.task.restore(state["task"], _stopped_error("the task"))
        except (KeyError, TypeError, ValueError, AttributeError, OSError):
            return None
        return user

    def changed(self) -> None:
        """Mark the state as changed, to be written soon."""
        self.users.to_write.add(self)

    def write(self) -> None:
        """Write the state beside the files."""
        form = self.form
        if form is not None:  # the chart can be drawn again
            guess = replace(form.guess, chart=b"")
            touched: Any = sorted(form.touched)
            form = replace(form, guess=guess, touched=touched)
        fields = ("owner", "tab", "seen", "confirmed", "profile", "results", "running")
        state = {
            **{name: getattr(self, name) for name in fields},
            "session": self.session.state,
            "form": form,
        }
        state["task"] = self.task.state
        state["stopped"] = dict(vars(self.stopped)) if self.stopped else None
        write_state(self.session.folder, state)

    @property
    def connected(self) -> bool:
        """Return whether a browser is connected."""
        return self.client is not None and bool(self.client.has_socket_connection)

    @property
    def busy(self) -> bool:
        """Return whether an identification is under way."""
        return self.job is not None and not self.job.over

    @property
    def empty(self) -> bool:
        """Return whether there is nothing to lose."""
        return not (self.session.names or self.results or self.busy or self.task.busy)

    @property
    def applicable_form(self) -> Form | None:
        """Return the form if it describes the data; None if a calibration file came with them."""
        has_calibration = any(name.lower().endswith(".toml") for name in self.session.names)
        return None if has_calibration else self.form

    def may(self, role: str) -> bool:
        """Return whether the account of this page has the role."""
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
            self.session.write_calibration(
                calibration_text(self.form.description, self.session.files)
            )

    def start(self, choices: Choices, *, again: bool = False) -> None:
        """Begin to identify with a copy of the data, if the account may.

        The outcome is in ``job`` and ``results``. ``again``: with the calibration file of the last
        identification, whatever the form says since.
        """
        self.require("identify", "identify")
        if not again:
            self.session.keep_last_calibration(choices.calibration)
        self.job = Job(choices=choices)
        self.running = choices
        self.stopped = None
        self.changed()
        self._task = asyncio.get_running_loop().create_task(self._identify(self.job, choices))

    async def _identify(self, job: Job, choices: Choices) -> None:
        try:
            async with self.session.new_folder("run") as copy:
                new_result = copy / f"new-{RESULT}"
                await asyncio.to_thread(self.session.copy_to, copy)
                self.session.use_last_calibration(copy, choices.calibration)
                if self.users.identifying.locked():
                    job.words = phrase("Waiting for other identifications …")
                async with self.users.identifying:
                    job.words = Job.BEGINNING
                    task = (identify, choices.calibration, choices.options, new_result)
                    await self.worker.run(*task, folder=copy, progress=job.add)
                job.words = phrase("Reading the result …")
                model, estimator = await self.run_sandboxed(model_and_estimator, new_result)
                await self.note("identified", new_result, model=model, estimator=estimator)
                prefixes = [named.name.partition(":")[0] for named in self.results]
                number = (
                    max((int(number) for number in prefixes if number.isdecimal()), default=0) + 1
                )
                self.keep_result(
                    f"{number}: {model}, {estimator}",
                    new_result,
                    copy / choices.calibration,
                    choices,
                )
                job.words = Job.DONE
        except asyncio.CancelledError:
            job.words = phrase("Cancelled.")
        except Exception as error:
            job.words = ""
            job.error = error
        finally:
            self.stopped = job.error if isinstance(job.error, StoppedError) else None
            job.over = True
            self.running = choices if self.stopped else None
            self.changed()

    def keep_result(
        self,
        name: str,
        source: Path,
        calibration: Path | None = None,
        choices: Choices | None = None,
    ) -> None:
        """Keep a result under a free name; evict the oldest beyond the limit."""
        path, evicted = self.session.keep_result(source, calibration)
        names_in_use = {named.name for named in self.results}
        alternatives = (f"{name} {number}" for number in range(2, len(names_in_use) + 3))
        free = next(
            candidate for candidate in (name, *alternatives) if candidate not in names_in_use
        )
        self.results.append(NamedResult(free, path, choices))
        lost = [named.name for named in self.results if named.path in evicted]
        self.results = [named for named in self.results if named.path not in evicted]
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
        self.results = []
        self.form = None
        self.confirmed = None
        self.notice = ""


def _stopped_error(during: str) -> StoppedError:
    return StoppedError(
        f"The server was stopped during {during}.",
        expected="a computation that runs to its end",
        found="a server that was started again",
        remedy="repeat it; the data and the form are here",
    )

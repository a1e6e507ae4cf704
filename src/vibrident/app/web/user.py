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
from vibrident.app.web.session import PageSession
from vibrident.app.web.state import (
    ConfirmedCalibration,
    Form,
    NamedResult,
    read_state,
    write_state,
)
from vibrident.app.web.task_run import TaskRun
from vibrident.app.web.tasks import TaskRequest
from vibrident.base.errors import InputError


class User:
    """State of one open page; not shared with other pages. ``users``: all of the server."""

    def __init__(self, users: Any, owner: str = "", tab: str = "", folder_name: str = "") -> None:
        self.users = users
        self.owner = owner
        self.tab = tab
        self.run_sandboxed = users.run_sandboxed
        self.session = PageSession(users.folder, users.limit_mb, users.make_room, folder_name)
        self.fit = TaskRun(self, "the identification")
        self.task = TaskRun(self, "the task")
        self.results: list[NamedResult] = []
        self.form: Form | None = None
        self.confirmed: ConfirmedCalibration | None = None
        self.profile = ""  # of the laboratory, by name; empty for none
        self.notice = ""
        self.client: Any = None
        self.last_seen_s = time.time()

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
            user.last_seen_s = state["last_seen_s"]
            user.profile = state["profile"]
            user.results = [named for named in state["results"] if named.path.exists()]
            if user.form is not None:
                user.form.touched = set(user.form.touched)
            for name in ("fit", "task"):
                getattr(user, name).restore(state[name])
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
        fields = ("owner", "tab", "last_seen_s", "confirmed", "profile", "results")
        state = {
            **{name: getattr(self, name) for name in fields},
            "session": self.session.state,
            "form": form,
            "fit": self.fit.state,
            "task": self.task.state,
        }
        write_state(self.session.folder, state)

    @property
    def connected(self) -> bool:
        """Return whether a browser is connected."""
        return self.client is not None and bool(self.client.has_socket_connection)

    @property
    def busy(self) -> bool:
        """Return whether an identification or a task is under way."""
        return self.fit.busy or self.task.busy

    @property
    def empty(self) -> bool:
        """Return whether there is nothing to lose."""
        return not (self.session.names or self.results or self.busy)

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

    def keep_result(
        self,
        name: str,
        source: Path,
        calibration: Path | None = None,
        request: TaskRequest | None = None,
    ) -> None:
        """Keep a result under a free name; evict the oldest beyond the limit."""
        path, evicted = self.session.keep_result(source, calibration)
        names_in_use = {named.name for named in self.results}
        alternatives = (f"{name} {number}" for number in range(2, len(names_in_use) + 3))
        free = next(
            candidate for candidate in (name, *alternatives) if candidate not in names_in_use
        )
        self.results.append(NamedResult(free, path, request))
        lost = [named.name for named in self.results if named.path in evicted]
        self.results = [named for named in self.results if named.path not in evicted]
        if lost:
            names = ", ".join(f"“{name}”" for name in lost)
            self.notice = phrase("Too many results; removed: {names}.", names=names)
        self.changed()

    def cancel(self) -> None:
        """End running processes."""
        self.fit.worker.cancel()
        self.task.worker.cancel()

    def close(self) -> None:
        """End running processes, remove the files."""
        self.cancel()
        self.session.close()
        self.users.to_write.discard(self)
        self.results = []
        self.form = None
        self.confirmed = None
        self.notice = ""

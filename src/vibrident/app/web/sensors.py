"""Build the list of sensors of the history and of this user's open work, by serial number."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

from nicegui import ui

from vibrident.app.web import frame, register
from vibrident.app.web.form.entries import PLAIN
from vibrident.app.web.language import page_language, translate, translate_count
from vibrident.app.web.outcome import MAX_STORE_BYTES
from vibrident.app.web.state import NamedResult
from vibrident.app.web.user import User
from vibrident.base.escaping import html
from vibrident.base.fields import Fields
from vibrident.data.io.certificate import CertificateData

_MAX_WORK = 40  # results listed of this user


class SensorsStep:
    """The section of sensors, and of the results whose certificates are not issued."""

    def __init__(self, user: User) -> None:
        self.user = user
        self.turn = 0

    def build(self, on_open: Callable[[str], Awaitable[Any]]) -> None:
        """Build the section; ``on_open`` is called with the name of a result of this tab."""
        self.on_open = on_open
        with frame.add_step(
            translate("Sensors and open work"), "sensors", mark="≡"
        ) as self.section:
            self.serial_input = ui.input(translate("Find a serial number")).props(
                f"{PLAIN} id=serial-wanted"
            )
            self.serial_input.style("max-width: 20rem")
            self.serial_input.on("keydown.enter", lambda: self.show())
            with frame.actions():
                frame.add_button(translate("Search"), lambda: self.show(), "outline id=find-serial")
            self.errors = frame.add_error_area()
            self.work_errors = frame.add_error_area()
            self.words = frame.hint("").props("role=status id=sensors-words")
            self.body = ui.element("div").props("id=sensors-body")
        self.section.visible = False

    def _work(self) -> list[tuple[User, NamedResult]]:
        """Return the results of this user in all tabs, those of this tab first."""
        closed_tabs = self.user.users.closed_tabs_of(self.user.owner)
        items = [
            (user, named) for user in (self.user, *closed_tabs) for named in reversed(user.results)
        ]
        return items[:_MAX_WORK]

    async def show(self) -> None:
        """Show what the store and this user's tabs hold of the wanted serial number."""
        user = self.user
        work = self._work()
        store = user.users.store
        serial_part = self.serial_input.value or ""
        if not (store or work):
            self.section.visible = False
            return
        self.turn += 1
        turn = self.turn
        summary: Fields = {"count": None, "table": ""}
        failed = bool(store)
        if store:
            call = (register.sensors, store, serial_part, page_language().code)
            with frame.reporting(self.errors, user):
                summary = await user.run_sandboxed(*call, file_bytes=MAX_STORE_BYTES)
                failed = False
        paths = [named.path for _, named in work]
        statements = [named.stated or CertificateData() for _, named in work]
        drafts = []
        with frame.reporting(self.work_errors, user):
            drafts = await user.run_sandboxed(register.drafts, paths, statements)
        if turn != self.turn or self.body.is_deleted:
            return
        folded = serial_part.strip().casefold()
        open_work = [
            (draft, *entry)
            for draft, entry in zip(drafts, work, strict=False)
            if folded in draft.serial_number.casefold()
        ]
        begun = summary["count"] is not None
        self.section.visible = begun or failed or bool(work)
        drafts_words = translate_count(len(open_work), "{count} open draft", "{count} open drafts")
        words = [drafts_words]
        if begun:
            singular = "{count} sensor in the history"
            plural = "{count} sensors in the history"
            words.insert(0, translate_count(summary["count"], singular, plural))
        self.words.text = ", ".join(words) + "."
        self.body.clear()
        with self.body:
            if open_work:
                frame.heading(translate("Open drafts"))
                with ui.element("div").props("role=list") as listing:
                    listing.props["aria-label"] = translate("Open drafts")
                    for draft, owner, named in open_work:
                        self._draft(draft, owner, named)
            if summary["table"]:
                frame.heading(translate("Sensors"))
                ui.html(summary["table"], sanitize=False)  # escaped in the process that made it

    def _draft(self, draft: register.CertifiableResult, owner: User, named: NamedResult) -> None:
        lacking = translate_count(draft.missing, "{count} entry missing", "{count} entries missing")
        missing = html(lacking if draft.missing else translate("complete"))
        serial = html(draft.serial_number or translate("no serial number"))
        with frame.actions().props("role=listitem"):
            ui.html(f"<b>{serial}</b> · {html(named.name)} · {missing}", sanitize=False)
            name = translate("Open {what}", what=f"{draft.serial_number} {named.name}")
            frame.add_button(
                translate("Open"), partial(self._open, owner, named), "outline dense", name=name
            )

    async def _open(self, owner: User, named: NamedResult) -> None:
        """Go to a result of this tab, or take over the tab that has it."""
        if owner is self.user:
            await self.on_open(named.name)
        elif self.user.users.hand_over(owner, self.user):
            ui.navigate.reload()

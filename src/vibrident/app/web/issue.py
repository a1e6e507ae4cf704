"""Build the step of a team's page in which a second account reviews drafts and issues them."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import ui

from vibrident.app.web import certificates, frame
from vibrident.app.web.language import phrase, say
from vibrident.app.web.outcome import offer_download
from vibrident.app.web.state import NamedResult
from vibrident.app.web.user import User
from vibrident.base.escaping import html
from vibrident.data.io.certificate import CertificateData
from vibrident.lab.issue.drafts import ISSUED, REVIEWED, same_account

_MAX_STORE_BYTES = 1 << 42  # most bytes of the store's file, as of the history
_LABELS = {
    "pdf": phrase("Certificate (PDF)"),
    "dcc": "DCC",
    "json": "result.json",
    "p7s": phrase("Its signature"),
}


class IssueStep:
    """The section of drafts and certificates of the store that all accounts share."""

    def __init__(self, user: User) -> None:
        self.user = user

    @property
    def is_offered(self) -> bool:
        """Return whether the page has accounts and a store.

        Without accounts nobody else could review a draft.
        """
        return self.user.users.door is not None and bool(self.user.users.store)

    def build(self) -> None:
        """Build the section, hidden until there is a draft."""
        self.section = frame.add_step(say("Review and issue"), "issue", mark="✓")
        with self.section:
            with frame.actions():
                refresh = ui.button(say("Look again"), on_click=self.show)
                refresh.props("outline id=refresh-drafts")
            self.words = frame.hint("").props("role=status id=issue-words")
            self.errors = frame.add_error_area()
            self.body = ui.element("div")
        self.section.visible = False

    async def show(self) -> None:
        """Show the drafts as the store has them now."""
        if not self.is_offered:
            return
        call = (certificates.list_drafts, self.user.users.store)
        drafts = await frame.run_sandboxed(
            self.user, self.errors, *call, file_bytes=_MAX_STORE_BYTES
        )
        if drafts is None or self.body.is_deleted:
            return
        self.section.visible = bool(drafts)
        self.body.clear()
        replaced = {each["replaces"]: each["number"] for each in drafts if each["number"]}
        with self.body:
            for each in drafts:
                self._entry(each, replaced.get(each["number"] or None))

    async def hand_in(self, named: NamedResult, data: CertificateData, errors: ui.element) -> None:
        """Hand in a draft of a result, and show it."""
        errors.clear()
        try:
            self.user.require("identify", "hand in a draft")
            arguments = (named.path, self.user.users.store, data, self.user.owner)
            number = await self.user.run_sandboxed(
                certificates.hand_in_draft, *arguments, file_bytes=_MAX_STORE_BYTES
            )
        except Exception as error:
            frame.show_error(errors, error, self.user.session)
            return
        await self.user.note("handed in", named.path, draft=number)
        await self.show()
        self.words.text = say(
            "Draft {number} waits for a review by another account.", number=number
        )
        frame.scroll_to(self.section)

    def _entry(self, draft: dict[str, Any], replaced_by: str | None) -> None:
        number = draft["id"]
        issued = draft["state"] == ISSUED
        title = (
            say("Certificate {number}", number=draft["number"])
            if issued
            else say("Draft {number}", number=number)
        )
        ui.html(f"<h3>{html(title)}: {html(draft['sensor'])}</h3>", sanitize=False)
        ui.label(_history(draft, replaced_by)).classes("hint")
        with frame.actions().props(f'id="draft-{number}"'):
            forms = _LABELS if issued else {"pdf": phrase("Draft (PDF)")}
            for form, label in forms.items():
                download = ui.button(say(label), on_click=partial(self._give, number, form))
                download.props("outline").props["aria-label"] = f"{say(label)}, {title}"
            if issued or not self.user.may("approve"):
                return
            if same_account(draft["author"], self.user.owner):
                frame.hint(say("Another account reviews what you handed in."))
            else:
                self._review(number)
            if draft["state"] == REVIEWED and self.user.users.key is not None:
                issue = ui.button(say("Issue and sign"), on_click=partial(self._issue, number))
                issue.props["aria-label"] = say("Issue and sign draft {number}", number=number)

    def _review(self, number: int) -> None:
        note = ui.input(say("What was found")).props("dense outlined stack-label")
        accept = say("Accept draft {number}", number=number)
        back = say("Return draft {number}", number=number)
        for label, called, accepted in (
            (say("Accept"), accept, True),
            (say("Return"), back, False),
        ):

            async def review(accepted: bool = accepted) -> None:
                await self._reviewed(number, accepted, note.value or "")

            button = ui.button(label, on_click=review)
            button.props("outline").props["aria-label"] = called

    async def _reviewed(self, number: int, accepted: bool, note: str) -> None:
        call = (certificates.review_draft, number, self.user.owner, accepted, note)
        if accepted:
            confirmation = say("Draft {number} is reviewed.", number=number)
            await self._change("review a draft", "reviewed", confirmation, *call)
        else:
            confirmation = say("Draft {number} is returned.", number=number)
            await self._change("review a draft", "returned", confirmation, *call)

    async def _issue(self, number: int) -> None:
        self.words.text = say("Signing …")
        call = (
            certificates.issue_certificate,
            number,
            self.user.owner,
            *(self.user.users.key or ()),
        )
        await self._change(
            "issue a certificate", "issued", say("Draft {number} is issued.", number=number), *call
        )

    async def _change(
        self, what: str, action: str, confirmation: str, function: Any, number: int, *args: Any
    ) -> None:
        """Make a change that needs the role ``approve``, note it, and show the drafts again."""
        self.errors.clear()
        try:
            self.user.require("approve", what)
            store = self.user.users.store
            await self.user.run_sandboxed(
                function, store, number, *args, file_bytes=_MAX_STORE_BYTES
            )
        except Exception as error:
            self.words.text = ""
            frame.show_error(self.errors, error, self.user.session)
            return
        await self.user.note(action, draft=number)
        await self.show()
        self.words.text = confirmation

    async def _give(self, number: int, form: str) -> None:
        self.errors.clear()
        call = (certificates.read_document, self.user.users.store, number, form)
        await offer_download(self.user, self.errors, str, *call, file_bytes=_MAX_STORE_BYTES)


def _history(draft: dict[str, Any], replaced_by: str | None) -> str:
    """Return a sentence on who did what with a draft."""
    steps = [
        say("handed in by {name} on {date}", name=draft["author"], date=draft["recorded"][:10])
    ]
    if draft["reviewer"]:
        returned = draft["state"] not in (REVIEWED, ISSUED)
        words = phrase("returned by {name}") if returned else phrase("reviewed by {name}")
        note = f" ({draft['note']})" if draft["note"] else ""
        steps.append(say(words, name=draft["reviewer"]) + note)
    if draft["state"] == ISSUED:
        steps.append(say("issued by {name} on {date}", name=draft["issuer"], date=draft["date"]))
    if draft["replaces"]:
        steps.append(say("replaces {number}", number=draft["replaces"]))
    if replaced_by:
        steps.append(say("replaced by {number}", number=replaced_by))
    text = "; ".join(steps)
    return f"{text[:1].upper()}{text[1:]}."

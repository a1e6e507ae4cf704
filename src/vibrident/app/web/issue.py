"""Build the step of a team's page in which a second account reviews drafts and issues them."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import ui

from vibrident.app.web import certificates, frame
from vibrident.app.web.language import phrase, translate
from vibrident.app.web.outcome import MAX_STORE_BYTES, offer_download
from vibrident.app.web.state import NamedResult
from vibrident.app.web.user import User
from vibrident.base.fields import Fields
from vibrident.data.io.certificate import CertificateData
from vibrident.lab.issue.drafts import DRAFTED, ISSUED, REVIEWED, same_account
from vibrident.show.views import capitalised

#: Document of a certificate → label of its button.
_DOCUMENTS = {
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
        self.section = frame.add_step(translate("Review and issue"), "issue", mark="✓")
        with self.section:
            with frame.actions():
                frame.add_button(translate("Look again"), self.show, "outline id=refresh-drafts")
            self.status = frame.hint("").props("role=status id=issue-words")
            self.errors = frame.add_error_area()
            self.body = ui.element("div")
        self.section.visible = False

    @frame.reported
    async def show(self) -> None:
        """Show the drafts that the store has now."""
        if not self.is_offered:
            return
        store = self.user.users.store
        drafts = await self.user.run_sandboxed(
            certificates.list_drafts, store, file_bytes=MAX_STORE_BYTES
        )
        if self.body.is_deleted:
            return
        self.section.visible = bool(drafts)
        self.body.clear()
        replacements = {draft["replaces"]: draft["number"] for draft in drafts if draft["number"]}
        with self.body:
            for draft in drafts:
                self._show_draft(draft, replacements.get(draft["number"] or None))

    async def hand_in(self, named: NamedResult, data: CertificateData) -> None:
        """Hand in a draft of a result, and show it."""
        self.user.require("identify", "hand in a draft")
        draft = (certificates.hand_in_draft, named.path, self.user.users.store, data)
        draft_id = await self.user.run_sandboxed(
            *draft, self.user.owner, file_bytes=MAX_STORE_BYTES
        )
        await self.user.note("handed in", named.path, draft=draft_id)
        await self.show()
        self.status.text = translate(
            "Draft {number} waits for a review by another account.", number=draft_id
        )
        frame.scroll_to(self.section)

    def _show_draft(self, draft: Fields, replaced_by: str | None) -> None:
        draft_id = draft["id"]
        is_issued = draft["state"] == ISSUED
        if is_issued:
            title = translate("Certificate {number}", number=draft["number"])
            documents = _DOCUMENTS
        else:
            title = translate("Draft {number}", number=draft_id)
            documents = {"pdf": phrase("Draft (PDF)")}
        frame.heading(f"{title}: {draft['sensor']}")
        frame.hint(_describe_history(draft, replaced_by))
        with frame.actions().props(f'id="draft-{draft_id}"'):
            for form, english in documents.items():
                label = translate(english)
                download = partial(self._download, draft_id, form)
                frame.add_button(label, download, name=f"{label}, {title}")
            if draft["state"] in {DRAFTED, REVIEWED} and self.user.may("approve"):
                self._build_approval(draft)

    def _build_approval(self, draft: Fields) -> None:
        """Build what an account with the role ``approve`` can do with a draft."""
        draft_id = draft["id"]
        if same_account(draft["author"], self.user.owner):
            frame.hint(translate("Another account reviews what you handed in."))
        else:
            note = ui.input(translate("What was found")).props("dense outlined stack-label")
            frame.add_button(
                translate("Accept"),
                lambda: self._review(draft_id, True, note.value or ""),
                name=translate("Accept draft {number}", number=draft_id),
            )
            frame.add_button(
                translate("Return"),
                lambda: self._review(draft_id, False, note.value or ""),
                name=translate("Return draft {number}", number=draft_id),
            )
        if draft["state"] == REVIEWED and self.user.users.key is not None:
            frame.add_button(
                translate("Issue and sign"),
                partial(self._issue, draft_id),
                "",
                name=translate("Issue and sign draft {number}", number=draft_id),
            )

    @frame.reported
    async def _review(self, draft_id: int, accepted: bool, note: str) -> None:
        action = "reviewed" if accepted else "returned"
        confirmation = "Draft {number} is reviewed." if accepted else "Draft {number} is returned."
        review = (certificates.review_draft, draft_id, self.user.owner, accepted, note)
        await self._change("review a draft", action, *review)
        self.status.text = translate(confirmation, number=draft_id)

    @frame.reported
    async def _issue(self, draft_id: int) -> None:
        self.status.text = translate("Signing …")
        key = self.user.users.key or ()
        issue = (certificates.issue_certificate, draft_id, self.user.owner, *key)
        await self._change("issue a certificate", "issued", *issue)
        self.status.text = translate("Draft {number} is issued.", number=draft_id)

    async def _change(
        self, purpose: str, action: str, function: Any, draft_id: int, *args: Any
    ) -> None:
        """Make a change that needs the role ``approve``, note it, and show the drafts again."""
        self.user.require("approve", purpose)
        try:
            await self.user.run_sandboxed(
                function, self.user.users.store, draft_id, *args, file_bytes=MAX_STORE_BYTES
            )
        finally:
            self.status.text = ""
        await self.user.note(action, draft=draft_id)
        await self.show()

    @frame.reported
    async def _download(self, draft_id: int, form: str) -> None:
        document = (certificates.read_document, self.user.users.store, draft_id, form)
        await offer_download(self.user, str, *document, file_bytes=MAX_STORE_BYTES)


def _describe_history(draft: Fields, replaced_by: str | None) -> str:
    """Return a sentence on who did what with a draft."""
    steps = [
        translate(
            "handed in by {name} on {date}", name=draft["author"], date=draft["recorded"][:10]
        )
    ]
    if draft["reviewer"]:
        is_accepted = draft["state"] in (REVIEWED, ISSUED)
        english = phrase("reviewed by {name}") if is_accepted else phrase("returned by {name}")
        note = f" ({draft['note']})" if draft["note"] else ""
        steps.append(translate(english, name=draft["reviewer"]) + note)
    if draft["state"] == ISSUED:
        steps.append(
            translate("issued by {name} on {date}", name=draft["issuer"], date=draft["date"])
        )
    if draft["replaces"]:
        steps.append(translate("replaces {number}", number=draft["replaces"]))
    if replaced_by:
        steps.append(translate("replaced by {number}", number=replaced_by))
    return f"{capitalised('; '.join(steps))}."

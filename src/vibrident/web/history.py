"""Below a result: what the history holds of its sensor, and a button that adds the result to it."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from vibrident.web import frame, looks
from vibrident.web.users import Named, User

#: Most bytes of the store's file: it may be as large as it likes, but a process that may write needs a number.
_ANY_SIZE = 1 << 42


class History:
    """The history of a result's sensor.

    Args:
        user: whose page it is.
        named: the result.
        store: URL of the store.
    """

    def __init__(self, user: User, named: Named, store: str) -> None:
        self.user, self.named, self.store = user, named, store

    async def build(self) -> None:
        """Build it, and show what is there."""
        ui.html("<h3>History</h3>", sanitize=False)
        with ui.element("div").classes("actions"):
            self.button = ui.button("Add to history", on_click=self._add).props("outline id=add-to-history")
        self.words = ui.label("").classes("hint").props("role=status id=history-words")
        self.errors = ui.element("div").props("aria-live=assertive")
        self.body = ui.element("div").props("id=history")
        await self._ask(looks.history)

    async def _add(self) -> None:
        self.button.disable()
        await self._ask(looks.added_to_history)
        if not self.button.is_deleted:
            self.button.enable()

    async def _ask(self, function: Any) -> None:
        self.errors.clear()
        shown = await frame.looked(self.user, self.errors, function, self.named.path, self.store, file_bytes=_ANY_SIZE)
        if shown is None or self.body.is_deleted:
            return
        self.words.text = shown["words"]
        self.body.clear()
        with self.body:
            for _, figure, height in shown["charts"]:
                frame.Chart(figure, height)
            ui.html(f'<div class="scroll">{shown["tables"]}</div>', sanitize=False)

"""What else can be done with the data and the result: the commands of the shell, with fields for their options."""

from __future__ import annotations

import asyncio
import base64
import shutil
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.held import Named
from vibrident.app.web.looks import facts
from vibrident.app.web.tasks import ALL, DATA, RESULT, TASKS
from vibrident.app.web.users import User
from vibrident.app.web.worker import ARCHIVE, OUT, Worker, command
from vibrident.base.errors import InputError

_RESULT_NAME = "chosen-result.json"


class ToolsStep:
    """A section that runs one of the commands and shows what it says."""

    def __init__(self, user: User) -> None:
        self.user = user
        self.worker = Worker()

    def build(self, on_result: Callable[..., Awaitable[Any]]) -> None:
        """Build the section, hidden until there are data or results."""
        self.on_result = on_result
        self.section = frame.step("More with these data", "more", mark="+")
        with self.section:
            self.tool = ui.select({name: tool.title for name, tool in TASKS.items()}, value="compare", label="Task")
            self.tool.props("dense outlined stack-label").classes("w-full").on_value_change(self._renew)
            self.hint = ui.label("").classes("hint")
            self.fields = ui.element("div").classes("fields wide")
            with ui.element("div").classes("actions"):
                self.start = ui.button("Run", on_click=self._run).props("id=run")
                self.stop = ui.button("Cancel", on_click=self.worker.cancel).props("outline color=negative")
                self.spinner = ui.spinner(size="28px")
            self.errors = ui.element("div").props("aria-live=assertive")
            self.body = ui.element("div").props('aria-live=polite id="said"')
        self.stop.visible = self.spinner.visible = False
        self._renew()
        self.show()

    def show(self) -> None:
        """Offer the results that there are."""
        self.section.visible = not self.user.empty
        if self.result is not None:
            names = [named.name for named in self.user.results]
            self.result.set_options(names, value=self.result.value or next(reversed(names), None))

    def _renew(self) -> None:
        tool = TASKS[self.tool.value]
        self.hint.text = tool.hint
        self.given: dict[str, Any] = {}
        self.result = None
        self.fields.clear()
        with self.fields:
            if RESULT in tool.command:
                names = [named.name for named in self.user.results]
                self.result = ui.select(names, value=names[-1] if names else None, label="Result")
                self.result.props("dense outlined stack-label")
            for flag, label in tool.fields.items():
                self.given[flag] = ui.input(label).props("dense outlined stack-label")
            for flag, label in tool.switches.items():
                self.given[flag] = ui.checkbox(label).props("dense")

    def _chosen(self) -> Named | None:
        return next((one for one in self.user.results if self.result and one.name == self.result.value), None)

    def arguments(self) -> list[str]:
        """The command, its options as one word each: no value can pass for another option."""
        words: list[str] = []
        for word in TASKS[self.tool.value].command:
            if word == DATA:
                confirmed = self.user.confirmed
                words.append(_there(confirmed and confirmed.name, "confirmed columns", "confirm the columns first"))
            elif word == ALL:
                found = [f"./{name}" for name in self.user.session.names if name.lower().endswith(".toml")]
                words += _there(found, "calibration files", "upload them, with their data")
            elif word == RESULT:
                _there(self._chosen(), "a result", "identify first, or upload an earlier one")
                words.append(_RESULT_NAME)
            else:
                words.append(word)
        for flag, made in self.given.items():
            if isinstance(made.value, bool):
                words += [flag] if made.value else []
            elif made.value:
                words.append(f"{flag}={made.value.strip()}")
        return [*words, f"--out={OUT}"]

    async def _run(self) -> None:
        user, session = self.user, self.user.session
        self.errors.clear()
        self.body.clear()
        try:
            user.require("identify", "do that")
            arguments = self.arguments()
            user.write_form()
            async with session.new_folder("tool") as folder:
                await asyncio.to_thread(session.copy_to, folder)
                if chosen := self._chosen():
                    await asyncio.to_thread(shutil.copyfile, chosen.path, folder / _RESULT_NAME)
                self._busy(True)
                async with user.users.identifying:
                    said = await self.worker.run(command, arguments, folder=folder)
                await user.note("ran", command=" ".join(arguments))
                if not self.body.is_deleted:
                    await self._tell(said, folder)
        except asyncio.CancelledError:
            return
        except Exception as error:
            frame.show_error(self.errors, error, session)
        finally:
            if not self.body.is_deleted:
                self._busy(False)

    def _busy(self, busy: bool) -> None:
        self.start.set_enabled(not busy)
        self.stop.visible = self.spinner.visible = busy

    async def _tell(self, said: dict[str, Any], folder: Path) -> None:
        archive = None
        if said["code"] == 0 and (folder / ARCHIVE).exists():
            archive = await asyncio.to_thread(self.user.session.download, folder / ARCHIVE)
        with self.body:
            if said["refused"] is not None:
                tool = TASKS[self.tool.value]
                frame.show_error(
                    self.errors, InputError(**said["refused"]), self.user.session, {**tool.fields, **tool.switches}
                )
                return
            if said["code"]:
                with ui.element("div").classes("error").props("role=alert"):
                    ui.label(said["errors"]).classes("problem")
                return
            frame.Text("said-text", "\n".join(filter(None, (said["text"].strip(), said["errors"].strip()))))
            for name, picture in said["pictures"]:
                data = base64.b64encode(picture).decode()
                ui.html(f'<img class="picture" alt="" src="data:image/png;base64,{data}">', sanitize=False)
                ui.label(name).classes("hint")
            if archive is not None:
                name = f"{self.tool.value}.zip"
                label = f"All {len(said['files'])} files (zip)" if len(said["files"]) > 1 else "The file (zip)"
                ui.button(label, on_click=lambda: ui.download.file(archive, name)).props("outline id=get-all")
        kept = 0
        for path in sorted((folder / OUT).rglob("result.json"))[:10]:
            model, estimator = await self.user.look(facts, path)
            self.user.keep(f"{TASKS[self.tool.value].title}: {path.parent.name}, {model}, {estimator}", path)
            kept += 1
        if kept:
            await self.on_result(go=False)


def _there(found: Any, what: str, remedy: str) -> Any:
    if not found:
        raise InputError("Something is missing for this task.", expected=what, found="none", remedy=remedy)
    return found

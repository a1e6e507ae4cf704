"""Build the first step: files by drop, by choice, as a folder, or from an example."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import events, ui

from vibrident.app.web import frame
from vibrident.app.web.language import say, say_count
from vibrident.app.web.sandboxed import model_and_estimator
from vibrident.app.web.session import (
    ACCEPTED_ENDINGS,
    MAX_FILES,
    MEGABYTE,
    safe_name,
    too_large_error,
)
from vibrident.app.web.user import User
from vibrident.app.web.worker import simulate_demo
from vibrident.base.errors import InputError
from vibrident.data.io.reader import unknown_format
from vibrident.show import views

_MAX_LISTED_FILES = 40  # most files listed one by one, each with a button to remove it
_MAX_REPORTED_FILES = 1000  # most omitted files whose names the browser reports
_UNKNOWN = "Not a supported kind of file ({kinds})"
#: Files of unknown format are not sent; the browser reports their names.
_FILTER = (
    f"files => files.filter(f => {json.dumps(ACCEPTED_ENDINGS)}.some(e => "
    "f.name.toLowerCase().endsWith(e)))"
)
_ON_REJECTED = (
    f"rejected => emit(rejected.slice(0, {_MAX_REPORTED_FILES}).map(r => [r.failedPropValidation, "
    "r.file.name]))"
)


class DataStep:
    """The section that takes files into the user's folder."""

    def __init__(self, user: User) -> None:
        self.user = user
        self.not_sent: dict[str, list[str]] = {}

    def build(
        self, on_data: Callable[[], Awaitable[Any]], on_result: Callable[[], Awaitable[Any]]
    ) -> None:
        """Build the section.

        ``on_data`` is called after files have arrived, ``on_result`` after an earlier result has.
        """
        self.on_data = on_data
        self.on_result = on_result
        limit_mb = self.user.session.limit_mb
        with frame.add_step(say("Data"), "data"):
            ui.label(
                say(
                    "Records of a calibration (CSV, HDF5, MATLAB, WAV, …), one file a record or "
                    "several, or one table of magnitude and phase; with a calibration file, if you "
                    "have one. Earlier results can be compared."
                )
            ).classes("hint")
            self.upload = (
                ui.upload(
                    multiple=True,
                    auto_upload=True,
                    label=say(
                        "Drop files or a folder here, or press + (at most {limit} MB)",
                        limit=f"{limit_mb:g}",
                    ),
                    max_total_size=int(limit_mb * MEGABYTE),
                    max_files=MAX_FILES,
                    on_multi_upload=self._arrived,
                )
                .classes("uploader")
                .props("flat bordered")
            )
            self.upload.props[":filter"] = _FILTER
            self.upload.on("start", lambda: self.errors.clear(), args=[])
            self.upload.on("rejected", self._rejected, js_handler=_ON_REJECTED)
            self.upload.on("failed", self._failed, args=[])
            self.upload.on("uploaded", js_handler=f"() => vibrident.sent({self.upload.id})")
            with frame.actions():
                ui.button(say("Choose a folder")).props("outline id=choose-folder")
                self.demo_button = ui.button(
                    say("Load the simulated demo"), on_click=self._demo
                ).props("outline")
                ui.button(say("Start anew"), on_click=self._ask_anew).props("flat")
            self.errors = frame.add_error_area()
            self.left_out = ui.element("div").props("aria-live=polite")
            self.listing = frame.hint("").props("role=status id=files")
            self.named = ui.element("div").classes("named").props("role=list")
            self.named.props["aria-label"] = say("Uploaded files")
        words = json.dumps([say("Choose files"), say("Files"), say("Folder")])
        ui.run_javascript(f"vibrident.folders({self.upload.id}, ...{words})")
        self.show()

    def hold(self) -> None:
        """Keep what there is; tell the browser whether there is something."""
        self.user.changed()
        self.upload.client.run_javascript(f"vibrident.hold({str(not self.user.empty).lower()})")

    def _rejected(self, event: events.GenericEventArguments) -> None:
        """Report the files that the browser did not send."""
        rejected = [(str(why), safe_name(str(name))) for why, name in event.args]
        unknown = [name for why, name in rejected if why == "filter"]
        large = [name for why, name in rejected if why != "filter"]
        if len(rejected) == 1 and unknown:
            frame.show_error(self.errors, unknown_format(Path(unknown[0]).suffix, unknown[0]))
            return
        self.not_sent = {self._unknown(): unknown, self._large(): large}
        self._left_out(self.not_sent)

    def _failed(self) -> None:
        limit = self.user.session.limit_mb
        self.upload.reset()
        frame.show_error(
            self.errors,
            InputError(
                "The files did not arrive.",
                expected=f"at most {limit:g} MB at once, and a connection to the server",
                found="an interrupted upload",
                where="upload",
                remedy="try again, with fewer large files at a time",
            ),
        )

    def _unknown(self) -> str:
        return say(_UNKNOWN, kinds=", ".join(ACCEPTED_ENDINGS))

    def _large(self) -> str:
        limit = f"{self.user.session.limit_mb:g}"
        return say(
            "Beyond the limit of {limit} MB and {number} files in all",
            limit=limit,
            number=MAX_FILES,
        )

    async def _arrived(self, event: events.MultiUploadEventArguments) -> None:
        session = self.user.session
        came = []
        results = False
        alone = len(event.files) == 1
        reasons = {
            unknown_format("", "").problem: self._unknown(),
            too_large_error(1.0).problem: self._large(),
        }
        left_out: dict[str, list[str]] = {}
        for file in event.files:
            try:
                if not file.name.lower().endswith(".json"):
                    self.user.require("identify", "upload data")
                path = session.reserve_path(file.name, file.size())
                try:
                    await file.save(path)
                except BaseException:
                    session.remove(path.name)
                    raise
                if path.suffix.lower() != ".json":
                    came.append(path.name)
                    continue
                try:  # an earlier result, checked in a separate process
                    await self.user.run_sandboxed(model_and_estimator, path)
                    self.user.keep_result(path.stem, path)
                finally:
                    session.remove(path.name)
                results = True
            except InputError as error:
                if alone:
                    frame.show_error(self.errors, error, session)
                else:
                    reason = reasons.get(error.problem, error.problem.rstrip("."))
                    left_out.setdefault(reason, []).append(safe_name(file.name))
            except Exception as error:
                frame.show_error(self.errors, error, session)
        if self.upload.is_deleted:
            return
        self._left_out({**self.not_sent, **left_out})
        self.not_sent = {}
        self.show()
        if results:
            await self.on_result()
        if came:
            await self.on_data()

    def _left_out(self, left_out: dict[str, list[str]]) -> None:
        self.left_out.clear()
        frame.show_left_out(
            self.left_out, {reason: names for reason, names in left_out.items() if names}
        )

    async def _demo(self) -> None:
        """Replace the data by the simulated demo."""
        self.errors.clear()
        self.left_out.clear()
        session = self.user.session
        try:
            if self.user.busy:
                raise InputError(
                    "An identification is under way.",
                    expected="none",
                    found="one",
                    where="examples",
                    remedy="wait for it, or cancel it",
                )
            self.demo_button.disable()
            self.listing.text = say("Simulating the calibration of the paper's accelerometer …")
            self.user.require("identify", "identify")
            session.clear()
            session.open()
            self.user.form = None
            await self.user.worker.run(simulate_demo, folder=session.data)
            session.rescan()
        except asyncio.CancelledError:
            return
        except Exception as error:
            frame.show_error(self.errors, error, session)
            return
        finally:
            self.demo_button.enable()
            self.show()
        await self.on_data()

    async def _remove(self, name: str) -> None:
        self.errors.clear()
        self.user.session.remove(name)
        self.show()
        await self.on_data()

    async def _ask_anew(self) -> None:
        """Ask before anything is lost."""
        if self.user.empty:
            await self._anew()
            return
        files = say_count(len(self.user.session.names), "{count} file", "{count} files")
        results = say_count(len(self.user.results), "{count} result", "{count} results")
        with ui.dialog() as dialog, ui.card().props("role=alertdialog") as card:
            card.props["aria-label"] = say("Start anew")
            question = say(
                "Remove {files}, the form and {results} from the page?",
                files=files,
                results=results,
            )
            ui.label(question).classes("problem")
            with frame.actions():
                remove = ui.button(say("Remove all"), on_click=lambda: dialog.submit(True))
                remove.props("color=negative")
                keep = ui.button(say("Keep"), on_click=lambda: dialog.submit(False))
                keep.props("outline autofocus")
        if await dialog:
            await self._anew()
        dialog.delete()

    async def _anew(self) -> None:
        self.user.close()
        self.errors.clear()
        self.left_out.clear()
        self.show()
        await self.on_data()
        await self.on_result()

    def show(self) -> None:
        """List the files."""
        names = self.user.session.names
        number = say_count(len(names), "{count} file", "{count} files")
        self.named.clear()
        if len(names) > views.listed(len(names), _MAX_LISTED_FILES):
            self.listing.text = f"{number}: {frame.list_names(names)}"
        else:
            self.listing.text = f"{number}:" if names else say("No data yet.")
            with self.named:
                for name in names:
                    with ui.element("span").classes("file").props("role=listitem"):
                        ui.label(name)
                        button = ui.button(icon="close", on_click=partial(self._remove, name))
                        button.props("flat round size=xs").props["aria-label"] = say(
                            "remove {thing}", thing=name
                        )
        self.hold()

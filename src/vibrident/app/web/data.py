"""Build the first step: the user uploads files or a folder, or loads the simulated demo."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import events, ui

from vibrident.app.web import frame
from vibrident.app.web.language import translate, translate_count
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

_MAX_LISTED_FILES = 40  # files listed one by one, each with a button to remove it
_MAX_REPORTED_FILES = 1000  # omitted files whose names the browser reports
_HINT = (
    "Records of a calibration (CSV, HDF5, MATLAB, WAV, …), one file a record or several, or one "
    "table of magnitude and phase; with a calibration file, if you have one. Earlier results can "
    "be compared."
)
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
        self.unsent: dict[str, list[str]] = {}  # reason → files that the browser did not send

    def build(
        self, on_data: Callable[[], Awaitable[Any]], on_result: Callable[[], Awaitable[Any]]
    ) -> None:
        """Build the section.

        ``on_data`` is called after files have arrived, ``on_result`` after an earlier result has.
        """
        self.on_data = on_data
        self.on_result = on_result
        with frame.add_step(translate("Data"), "data"):
            frame.hint(translate(_HINT))
            self._build_upload()
            with frame.actions():
                ui.button(translate("Choose a folder")).props("outline id=choose-folder")
                self.demo_button = frame.add_button(
                    translate("Load the simulated demo"), self._load_demo
                )
                frame.add_button(translate("Start anew"), self._confirm_reset, "flat")
            self.errors = frame.add_error_area()
            self.left_out = ui.element("div").props("aria-live=polite")
            self.summary = frame.hint("").props("role=status id=files")
            self.file_list = ui.element("div").classes("named").props("role=list")
            self.file_list.props["aria-label"] = translate("Uploaded files")
        labels = [translate("Choose files"), translate("Files"), translate("Folder")]
        ui.run_javascript(f"vibrident.folders({self.upload.id}, ...{json.dumps(labels)})")
        self.show()

    def _build_upload(self) -> None:
        limit_mb = self.user.session.limit_mb
        self.upload = ui.upload(
            multiple=True,
            auto_upload=True,
            label=translate(
                "Drop files or a folder here, or press + (at most {limit} MB)",
                limit=f"{limit_mb:g}",
            ),
            max_total_size=int(limit_mb * MEGABYTE),
            max_files=MAX_FILES,
            on_multi_upload=self._take_files,
        )
        frame.style_upload(self.upload).props[":filter"] = _FILTER
        self.upload.on("start", lambda: self.errors.clear(), args=[])
        self.upload.on("rejected", self._report_rejected, js_handler=_ON_REJECTED)
        self.upload.on("failed", self._report_interruption, args=[])

    def save_state(self) -> None:
        """Save the user's state, and tell the browser whether there is any."""
        self.user.changed()
        self.upload.client.run_javascript(f"vibrident.hold({str(not self.user.empty).lower()})")

    def _report_rejected(self, event: events.GenericEventArguments) -> None:
        """Report the files that the browser did not send."""
        unknown = []
        large = []
        for cause, name in event.args:
            (unknown if cause == "filter" else large).append(safe_name(str(name)))
        if len(unknown) == 1 and not large:
            frame.show_error(self.errors, unknown_format(Path(unknown[0]).suffix, unknown[0]))
            return
        self.unsent = {self._unknown_reason(): unknown, self._large_reason(): large}
        self._show_left_out(self.unsent)

    def _report_interruption(self) -> None:
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

    def _unknown_reason(self) -> str:
        kinds = ", ".join(ACCEPTED_ENDINGS)
        return translate("Not a supported kind of file ({kinds})", kinds=kinds)

    def _large_reason(self) -> str:
        limit = f"{self.user.session.limit_mb:g}"
        return translate(
            "Beyond the limit of {limit} MB and {number} files in all",
            limit=limit,
            number=MAX_FILES,
        )

    async def _take_files(self, event: events.MultiUploadEventArguments) -> None:
        """Keep uploaded files, and report those that cannot be kept."""
        session = self.user.session
        has_data = False
        has_results = False
        reasons = {
            unknown_format("", "").problem: self._unknown_reason(),
            too_large_error(1.0).problem: self._large_reason(),
        }
        left_out: dict[str, list[str]] = {}
        for file in event.files:
            try:
                if await self._take_file(file):
                    has_results = True
                else:
                    has_data = True
            except Exception as error:
                if isinstance(error, InputError) and len(event.files) > 1:
                    reason = reasons.get(error.problem, error.problem.rstrip("."))
                    left_out.setdefault(reason, []).append(safe_name(file.name))
                else:
                    frame.show_error(self.errors, error, session)
        if self.upload.is_deleted:
            return
        self._show_left_out({**self.unsent, **left_out})
        self.unsent = {}
        self.show()
        if has_results:
            await self.on_result()
        if has_data:
            await self.on_data()

    async def _take_file(self, file: Any) -> bool:
        """Keep an uploaded file; return whether it is an earlier result."""
        session = self.user.session
        if not file.name.lower().endswith(".json"):
            self.user.require("identify", "upload data")
        path = await session.save_upload(file)
        if path.suffix.lower() != ".json":
            return False
        try:
            # read in a separate process, which checks it
            await self.user.run_sandboxed(model_and_estimator, path)
            self.user.keep_result(path.stem, path)
        finally:
            session.remove(path.name)
        return True

    def _show_left_out(self, left_out: dict[str, list[str]]) -> None:
        self.left_out.clear()
        frame.show_left_out(
            self.left_out, {reason: names for reason, names in left_out.items() if names}
        )

    @frame.reported
    async def _load_demo(self) -> None:
        """Replace the data by the simulated demo."""
        self.left_out.clear()
        session = self.user.session
        try:
            if self.user.fit.busy:
                raise InputError(
                    "An identification is under way.",
                    expected="none",
                    found="one",
                    where="examples",
                    remedy="wait for it, or cancel it",
                )
            self.demo_button.disable()
            self.summary.text = translate(
                "Simulating the calibration of the paper's accelerometer …"
            )
            self.user.require("identify", "identify")
            session.clear()
            session.open()
            self.user.form = None
            await self.user.fit.worker.run(simulate_demo, folder=session.data)
            session.rescan()
        except asyncio.CancelledError:
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

    async def _confirm_reset(self) -> None:
        """Remove everything from the page, after a question if there is anything."""
        if self.user.empty:
            await self._reset()
            return
        files = translate_count(len(self.user.session.names), "{count} file", "{count} files")
        results = translate_count(len(self.user.results), "{count} result", "{count} results")
        with ui.dialog() as dialog, ui.card().props("role=alertdialog") as card:
            card.props["aria-label"] = translate("Start anew")
            question = translate(
                "Remove {files}, the form and {results} from the page?",
                files=files,
                results=results,
            )
            ui.label(question).classes("problem")
            with frame.actions():
                frame.add_button(
                    translate("Remove all"), lambda: dialog.submit(True), "color=negative"
                )
                frame.add_button(
                    translate("Keep"), lambda: dialog.submit(False), "outline autofocus"
                )
        if await dialog:
            await self._reset()
        dialog.delete()

    async def _reset(self) -> None:
        self.user.close()
        self.errors.clear()
        self.left_out.clear()
        self.show()
        await self.on_data()
        await self.on_result()

    def show(self) -> None:
        """List the files."""
        names = self.user.session.names
        number = translate_count(len(names), "{count} file", "{count} files")
        self.file_list.clear()
        if len(names) > views.listed(len(names), _MAX_LISTED_FILES):
            self.summary.text = f"{number}: {frame.list_names(names)}"
        else:
            self.summary.text = f"{number}:" if names else translate("No data yet.")
            with self.file_list:
                for name in names:
                    with ui.element("span").classes("file").props("role=listitem"):
                        ui.label(name)
                        frame.add_remove_button(partial(self._remove, name), name, size="xs")
        self.save_state()

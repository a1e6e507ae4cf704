"""First step: files come in by drop, by choice, as a folder, or from the simulated demo."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import events, run, ui

from vibrident.errors import InputError, VibridentError
from vibrident.io.readers import READERS
from vibrident.result import Result
from vibrident.web import frame
from vibrident.web.hdf5_links import refuse_other_files
from vibrident.web.session import MEGABYTE, MOST_FILES, too_large

#: A folder is taken apart by the browser; the uploader itself takes files alone.
_FOLDERS = """
(() => {
  const box = getElement(%(id)d), root = getHtmlElement(%(id)d), picker = document.createElement('input');
  const add = files => box.$refs.qRef.addFiles([...files].filter(f => !f.name.startsWith('.')));
  const walk = async entry => entry.isFile
    ? [await new Promise((yes, no) => entry.file(yes, no))]
    : (await Promise.all((await all(entry.createReader())).map(walk))).flat();
  const all = async reader => {
    const found = [];
    for (;;) {
      const some = await new Promise((yes, no) => reader.readEntries(yes, no));
      if (!some.length) return found;
      found.push(...some);
    }
  };
  picker.type = 'file'; picker.webkitdirectory = true; picker.style.display = 'none'; root.after(picker);
  picker.onchange = () => { add(picker.files); picker.value = ''; };
  document.getElementById('choose-folder').onclick = () => picker.click();
  root.addEventListener('drop', async event => {
    const entries = [...event.dataTransfer.items].map(i => i.webkitGetAsEntry?.()).filter(Boolean);
    if (!entries.some(entry => entry.isDirectory)) return;
    event.preventDefault(); event.stopImmediatePropagation();
    add((await Promise.all(entries.map(walk))).flat());
  }, true);
})()
"""


class DataStep:
    """Files into the user's folder."""

    def __init__(self, user: frame.User) -> None:
        self.user = user

    def build(self, on_data: Callable[[], Any], on_result: Callable[[], Any]) -> None:
        """Build the section; ``on_data`` is called when files have come, ``on_result`` when an earlier result has."""
        self.on_data, self.on_result = on_data, on_result
        limit = int(self.user.session.limit_mb * MEGABYTE)
        with frame.step(1, "Data", "data"):
            ui.label(
                "Records of a calibration (CSV, HDF5, MATLAB, WAV, …), one file a record or several, or one table of "
                "magnitude and phase; with calibration.toml, if you have one. A result.json of before can be compared."
            ).classes("hint")
            self.upload = (
                ui.upload(
                    multiple=True,
                    auto_upload=True,
                    label=f"Drop files or a folder here, or press + (at most {self.user.session.limit_mb:g} MB)",
                    max_total_size=limit,
                    max_files=MOST_FILES,
                    on_multi_upload=self._arrived,
                    on_rejected=lambda: frame.show_error(self.errors, too_large(self.user.session.limit_mb)),
                )
                .classes("uploader")
                .props(f'flat bordered accept="{",".join((*READERS, ".toml", ".json"))}"')
            )
            # A file of an unknown format is to get the command line's message, not to be dropped in silence.
            self.upload.props(remove="accept")
            with ui.element("div").classes("actions"):
                ui.button("Choose a folder").props("outline id=choose-folder")
                self.demo_button = ui.button("Load the simulated demo", on_click=self._demo).props("outline")
                ui.button("Start anew", on_click=self._anew).props("flat")
            self.errors = ui.element("div").props("aria-live=assertive")
            self.listing = ui.label("").classes("hint").props("role=status id=files")
        ui.context.client.on_connect(lambda: ui.run_javascript(_FOLDERS % {"id": self.upload.id}))

    async def _arrived(self, event: events.MultiUploadEventArguments) -> None:
        self.errors.clear()
        session, came = self.user.session, False
        try:
            for file in event.files:
                place = session.place_for(file.name, file.size())
                await file.save(place)
                if place.suffix.lower() == ".json":
                    content = place.read_bytes()
                    place.unlink()
                    self._result(place.stem, content)
                else:
                    await self._checked(place)
                    came = True
        except VibridentError as error:
            frame.show_error(self.errors, error, session)
        self.upload.reset()
        self._list()
        if came and session.files:
            await self.on_data()

    async def _checked(self, place: Path) -> None:
        try:
            await run.io_bound(refuse_other_files, place)
        except InputError:
            place.unlink(missing_ok=True)
            raise

    def _result(self, name: str, content: bytes) -> None:
        place = self.user.session.folder / "earlier.json"
        place.write_bytes(content)
        try:
            result = Result.load(place)
        except InputError as error:
            raise InputError(**{**vars(error), "where": error.where.replace(str(place), f"{name}.json")}) from None
        finally:
            place.unlink()
        taken = {named.name for named in self.user.results}
        free = next(n for n in (name, *(f"{name} {i}" for i in range(2, 99))) if n not in taken)
        self.user.results.append(frame.Named(free, result, content))
        self.on_result()

    async def _demo(self) -> None:
        self.errors.clear()
        self.demo_button.disable()
        self.listing.text = "Simulating the calibration of the paper's accelerometer …"
        try:
            await run.io_bound(self.user.session.clear)
            async for _ in self.user.worker.run({"task": "demo"}, self.user.session.data):
                pass
        except VibridentError as error:
            frame.show_error(self.errors, error, self.user.session)
            return
        except asyncio.CancelledError:
            return
        finally:
            self.demo_button.enable()
            self._list()
        await self.on_data()

    async def _anew(self) -> None:
        self.user.worker.cancel()
        self.user.session.clear()
        self.errors.clear()
        self._list()
        await self.on_data()

    def _list(self) -> None:
        files = self.user.session.files
        shown = ", ".join(files[:6]) + (f" and {len(files) - 6} more" if len(files) > 6 else "")
        self.listing.text = f"{len(files)} file{'s' * (len(files) != 1)}: {shown}" if files else "No data yet."

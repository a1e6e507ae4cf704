"""Ask for known responses of the channels: a certificate, poles and zeros, a result, corners.

Their files are uploaded here, apart from the records, or are results of this page.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import PurePath
from typing import Any

from nicegui import events, ui

from vibrident.app.web import frame
from vibrident.app.web.form.description import ENTRY_NAMES, KNOWN_RESPONSES
from vibrident.app.web.form.entries import RowEntries
from vibrident.app.web.language import phrase, translate
from vibrident.app.web.session import MEGABYTE, RESPONSE_ENDINGS
from vibrident.app.web.user import User
from vibrident.base.fields import Fields, GivenFields
from vibrident.data.io.keys import Key, keys_of
from vibrident.data.io.known_section import KnownResponseEntry

_FILE = "file"
_CORNERS = "corners"
_WAYS = {
    _FILE: phrase("in a file"),
    _CORNERS: phrase("as corners of a conditioner"),
}
_TITLES = {
    "reference": phrase("Known responses of the reference's channel"),
    "response": phrase("Known responses of the response's channel"),
}
_K = 2.0  # coverage factor that is usual
#: Keys of a table, and of corners; the others hold for both ways.
_OF_TABLES = (
    *("frequency", "magnitude", "phase", "phase_unit"),
    *("magnitude_uncertainty", "phase_uncertainty", "coverage_factor"),
)
_OF_CORNERS = ("highpass_hz", "lowpass_hz", "gain", "corner_uncertainty")
_HZ: GivenFields = {"kind": "number", "in_form": ("Hz", 1.0)}
_PERCENT: GivenFields = {"in_form": ("%", 100.0)}
#: Key → its words in the form, and what differs from the file there.
_FILE_FIELDS: Mapping[str, tuple[str, GivenFields]] = {
    "file": (phrase("File"), {"kind": "choice"}),
    "frequency": (phrase("Frequency: column"), {}),
    "magnitude": (phrase("Magnitude: column"), {}),
    "phase": (phrase("Phase: column"), {}),
    "phase_unit": (phrase("Unit of the phase"), {}),
    "magnitude_uncertainty": (phrase("U of the magnitude: column"), {}),
    "phase_uncertainty": (phrase("U of the phase: column"), {}),
    "coverage_factor": (phrase("k of these U"), {"default": _K}),
    "highpass_hz": (phrase("High-pass corner"), _HZ),
    "lowpass_hz": (phrase("Low-pass corner"), _HZ),
    "gain": (phrase("Gain between the corners"), {}),
    "corner_uncertainty": (phrase("u of the corners, relative"), _PERCENT),
    "unit": (phrase("Unit, such as V/(m/s^2)"), {}),
    "standard_uncertainty": (phrase("u of the magnitude, relative"), _PERCENT),
}
_FILE_KEYS = keys_of(KnownResponseEntry)
KEYS = [
    Key("stated_as", _FILE, "choice", _WAYS, None, "", phrase("Stated")),
    *(
        replace(_FILE_KEYS[name], title=words, **more)
        for name, (words, more) in _FILE_FIELDS.items()
    ),
]


def applies(key: Key, row: GivenFields) -> bool:
    """Return whether a key has a meaning beside the values of the others."""
    is_in_file = (row.get("stated_as") or _FILE) == _FILE
    if key.name in _OF_TABLES:
        file = PurePath(row.get("file") or "x.json")
        return is_in_file and file.suffix.lower() not in (".json", *RESPONSE_ENDINGS)
    return is_in_file if key.name == "file" else key.name not in _OF_CORNERS or not is_in_file


def row_of_entry(entry: GivenFields) -> Fields:
    """Return an entry of the file as the form asks for it."""
    corners = {name: entry[name][0] for name in ("highpass_hz", "lowpass_hz") if entry.get(name)}
    return {"stated_as": _CORNERS if corners else _FILE, **entry, **corners}


def entry_of_row(row: GivenFields) -> Fields:
    """Return a filled row as the file states it; a corner is a list there, and k is stated."""
    entry = {name: value for name, value in row.items() if name != "stated_as"}
    if {"magnitude_uncertainty", "phase_uncertainty"} & {*entry}:
        entry.setdefault("coverage_factor", _K)
    corners = {name: [entry[name]] for name in ("highpass_hz", "lowpass_hz") if name in entry}
    return {**entry, **corners}


class KnownResponses:
    """The rows of both channels, and the files that they take."""

    def __init__(
        self,
        user: User,
        set_value: Callable[[str, Any], None],
        list_files: Callable[[], None],
    ) -> None:
        """Build the rows.

        ``set_value`` takes a path of the form and its value; ``list_files`` shows the files.
        """
        self.user = user
        self.set_value = set_value
        self.list_files = list_files
        self.rows: dict[str, RowEntries] = {}
        hint = translate(
            "A sensor beside another one, or behind an amplifier: state what is known of each "
            "channel. Several are a chain, from the recorder to the motion."
        )
        frame.hint(hint)
        self._build_upload()
        self.errors = frame.add_error_area()
        self.elements: dict[str, ui.element] = {}
        for path in KNOWN_RESPONSES:
            channel = path.partition(".")[0]
            with ui.element("div").classes("w-full").props(f"id=known-{channel}") as element:
                frame.heading(translate(_TITLES[channel]), 4)
                self._build_rows(path)
            self.elements[path] = element

    def _build_rows(self, path: str) -> None:
        form = self.user.form
        assert form is not None
        rows = RowEntries(
            ENTRY_NAMES["known_response"],
            KEYS,
            form.get(path) or [],
            options={"file": self.offered_files},
            applies=applies,
            to_form=row_of_entry,
            to_file=entry_of_row,
        )
        rows.on_change = lambda: self._take_rows(path, rows)
        self.rows[path] = rows

    @property
    def offered_files(self) -> dict[str | None, str]:
        """Return the files to choose from, with their labels: uploaded ones, then results."""
        session = self.user.session
        names = [*session.known_files, *session.files]
        results = {_result_file(result.path): result.name for result in self.user.results}
        return {None: translate("none"), **{name: name for name in names}, **results}

    def _take_rows(self, path: str, rows: RowEntries) -> None:
        """Set the form's entries to the rows; copy a chosen result beside the records."""
        entries = rows.value
        session = self.user.session
        with frame.reporting(self.errors, self.user):
            for named in self.user.results:
                file = _result_file(named.path)
                has_result = any(entry.get("file") == file for entry in entries)
                if has_result and file not in session.known_files:
                    size = named.path.stat().st_size
                    target = session.reserve_path(file, size, is_response=True)
                    shutil.copyfile(named.path, target)
                    self.list_files()
        self.set_value(path, entries)

    def _build_upload(self) -> None:
        limit = int(self.user.session.limit_mb * MEGABYTE)
        label = translate("Files of known responses: a table, StationXML, RESP, SACPZ, result.json")
        with ui.element("div").classes("w-full").props("id=known-files"):
            upload = ui.upload(
                label=label,
                multiple=True,
                auto_upload=True,
                max_total_size=limit,
                on_upload=self._take_file,
            )
        frame.style_upload(upload)
        choose = translate("Choose files of known responses")
        frame.name_upload(upload, choose, label.partition(":")[0])

    @frame.reported
    async def _take_file(self, event: events.UploadEventArguments) -> None:
        self.user.require("identify", "upload data")
        await self.user.session.save_upload(event.file, is_response=True)
        self.list_files()
        for rows in self.rows.values():
            rows.offer("file", self.offered_files)


def _result_file(path: PurePath) -> str:
    """Return the name that a result of this page has beside the records."""
    return f"result-{path.stem}.json"

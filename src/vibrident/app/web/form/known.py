"""Ask for known responses of the channels: a certificate, poles and zeros, a result, corners.

Their files are uploaded here, apart from the records, or are results of this page.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

from nicegui import events, ui

from vibrident.app.web import frame
from vibrident.app.web.form.description import ENTRY_NAMES, KNOWN_RESPONSES
from vibrident.app.web.form.entries import RowEntries
from vibrident.app.web.language import phrase, translate
from vibrident.app.web.session import MEGABYTE, RESPONSE_ENDINGS
from vibrident.app.web.user import User
from vibrident.data.io.keys import Key

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
_UNIT = ("%", 100.0)
_K = 2.0  # coverage factor that is usual


@dataclass(frozen=True)
class KnownKey(Key):
    """A key of one way to state a response, or of files that are tables."""

    way: str = ""
    of_tables: bool = False

    def applies(self, row: Mapping[str, Any]) -> bool:
        """Return whether the key has a meaning beside the values of the others."""
        file = str(row.get("file") or "")
        table = bool(file) and PurePath(file).suffix.lower() not in (".json", *RESPONSE_ENDINGS)
        stated_as = row.get("stated_as") or _FILE
        return self.way in ("", stated_as) and (table or not self.of_tables)


def _keys() -> list[Key]:
    def column(name: str, title: str) -> Key:
        return KnownKey(name, None, "column", {}, None, "", title, way=_FILE, of_tables=True)

    def number(name: str, title: str, way: str = "", usual: Any = None, **fields: Any) -> Key:
        return KnownKey(name, usual, "number", {}, None, "", title, way=way, **fields)

    hz: dict[str, Any] = {"in_form": ("Hz", 1.0)}
    percent: dict[str, Any] = {"in_form": _UNIT}
    degrees = {"deg": "deg", "rad": "rad"}
    return [
        KnownKey("stated_as", _FILE, "choice", _WAYS, None, "", phrase("Stated")),
        KnownKey("file", None, "choice", {}, None, "", phrase("File"), way=_FILE),
        column("frequency", phrase("Frequency: column")),
        column("magnitude", phrase("Magnitude: column")),
        column("phase", phrase("Phase: column")),
        KnownKey(
            "phase_unit",
            "deg",
            "choice",
            degrees,
            None,
            "",
            phrase("Unit of the phase"),
            way=_FILE,
            of_tables=True,
        ),
        column("magnitude_uncertainty", phrase("U of the magnitude: column")),
        column("phase_uncertainty", phrase("U of the phase: column")),
        number("coverage_factor", phrase("k of these U"), _FILE, _K, of_tables=True),
        number("highpass_hz", phrase("High-pass corner"), _CORNERS, **hz),
        number("lowpass_hz", phrase("Low-pass corner"), _CORNERS, **hz),
        number("gain", phrase("Gain between the corners"), _CORNERS),
        number("corner_uncertainty", phrase("u of the corners, relative"), _CORNERS, **percent),
        KnownKey("unit", None, "text", {}, None, "", phrase("Unit, such as V/(m/s^2)")),
        number("standard_uncertainty", phrase("u of the magnitude, relative"), **percent),
    ]


KEYS = _keys()


def row_of_entry(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return an entry of the file as the form asks for it."""
    corners = {name: entry[name][0] for name in ("highpass_hz", "lowpass_hz") if entry.get(name)}
    return {"stated_as": _CORNERS if corners else _FILE, **entry, **corners}


def entry_of_row(row: Mapping[str, Any]) -> dict[str, Any]:
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
        results = {_result_file(each.path): each.name for each in self.user.results}
        return {None: translate("none"), **{name: name for name in names}, **results}

    def _take_rows(self, path: str, rows: RowEntries) -> None:
        """Set the form's entries to the rows; copy a chosen result beside the records."""
        self.errors.clear()
        entries = rows.value
        session = self.user.session
        try:
            for named in self.user.results:
                file = _result_file(named.path)
                has_result = any(entry.get("file") == file for entry in entries)
                if has_result and file not in session.known_files:
                    size = named.path.stat().st_size
                    target = session.reserve_path(file, size, is_response=True)
                    shutil.copyfile(named.path, target)
                    self.list_files()
        except Exception as error:
            frame.show_error(self.errors, error, session)
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

    async def _take_file(self, event: events.UploadEventArguments) -> None:
        session = self.user.session
        self.errors.clear()
        try:
            self.user.require("identify", "upload data")
            await session.save_upload(event.file, is_response=True)
        except Exception as error:
            frame.show_error(self.errors, error, session)
            return
        self.list_files()
        for rows in self.rows.values():
            rows.offer("file", self.offered_files)


def _result_file(path: PurePath) -> str:
    """Return the name that a result of this page has beside the records."""
    return f"result-{path.stem}.json"

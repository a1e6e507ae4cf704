"""What a certificate states beside the numbers: a form below the result, and the laboratory's part of it remembered."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

from nicegui import events, ui

from vibrident.app.web import frame
from vibrident.app.web.held import Named
from vibrident.app.web.users import User
from vibrident.app.web.words import LABELS
from vibrident.base.errors import InputError
from vibrident.data.io.certificate import CertificateData, certificate_section, certificate_text
from vibrident.show.issue import FormField, form, lacking
from vibrident.show.language import ENGLISH

_MOST_OWN, _MOST_TEXT = 200_000, 100_000  # most bytes of a logo or a template, and most characters of all entries
#: The laboratory's own files: what they are, and their endings.
_OWN = {"logo": ("PNG, JPEG or SVG", ".png,.jpg,.jpeg,.svg"), "template": ("a typst file in place of ours", ".typ")}
_SENSOR = ("manufacturer", "type", "serial_number")
#: What is the same on every certificate of a laboratory: kept by the browser, and offered where nothing else is stated.
_PROFILE = (
    *("laboratory", "laboratory_address", "accreditation", "country", "operator", "approved_by", "place", "procedure"),
    *("traceability", "instruments", "language", "second_language", "decision_rule"),
)
_UNITS = {"c": "°C", "percent": "%", "hpa": "hPa", "hz": "Hz"}
_LANGUAGES = {"en": "English", "de": "German", "fr": "French", "zh": "Chinese"}
#: The entries of a row, with their labels.
_INSTRUMENT = {
    **{"name": "Name", "manufacturer": "Manufacturer", "type": "Type", "serial_number": "Serial number"},
    **{"certificate": "Certificate", "calibrated_until": "Calibrated until"},
}
_REQUIREMENT = {
    **{"quantity": "Quantity", "low": "Low limit", "high": "High limit", "from_hz": "From, Hz", "to_hz": "To, Hz"},
    "source": "Source",
}
_NUMBERS = ("low", "high", "from_hz", "to_hz")


class CertificateForm:
    """The form of one result, with which what is stated is kept.

    ``known`` is what the result itself states: ``certificate``, ``sensor``, and the names of its ``parameters``.
    """

    def __init__(self, user: User, named: Named, known: Mapping[str, Any]) -> None:
        self.user, self.named, self.known = user, named, known
        self.entries: dict[str, Any] = {}
        self.of_sensor: dict[str, Any] = {}

    def build(self) -> None:
        """Build a line that says what is missing, and the form, which is made when it is opened."""
        self.lacking = ui.label("").classes("hint").props("role=status id=lacking")
        self._say()
        if not self.user.may("identify"):
            return
        self.place = ui.expansion(LABELS["export.certificate"]).classes("w-full").props("id=certificate")
        self.place.on_value_change(self._open)

    def given(self) -> CertificateData:
        """What is stated beside the result, with logo and template."""
        own = self.named.stated or CertificateData()
        before = own.before if own.before and own.before.exists() else None
        return replace(own, before=before, **{kind: self.user.session.own(kind) for kind in _OWN})

    def _stated(self) -> tuple[dict[str, Any], dict[str, Any]]:
        own = self.named.stated or CertificateData()
        return {**self.known["certificate"], **own.certificate}, {**self.known["sensor"], **own.sensor}

    def _say(self) -> None:
        missing = lacking(*self._stated())
        names = ", ".join(str(ENGLISH("label", key)) for key in missing)
        self.lacking.text = (
            f"The PDF is a draft until these are stated: {names}." if missing else "Nothing is missing in the PDF."
        )

    async def _open(self) -> None:
        if not self.place.value or self.entries:
            return
        stated, sensor = self._stated()
        stated = {**await self._remembered(), **{key: value for key, value in stated.items() if value is not None}}
        with self.place:
            ui.label(
                "* is asked for by ISO/IEC 17025:2017, 7.8. The browser remembers what is the same on each of the "
                "laboratory's certificates."
            ).classes("hint")
            with frame.group("Object", 4):
                for key in _SENSOR:
                    label = str(ENGLISH("label", key)) + (" *" if key == "serial_number" else "")
                    self.of_sensor[key] = _plain(ui.input(label, value=str(sensor.get(key) or "")))
            asked = form()
            for title in dict.fromkeys(entry.group for entry in asked):
                mine = [entry for entry in asked if entry.group == title]
                with frame.group(title, 4):
                    for entry in mine:
                        if entry.kind not in ("instruments", "requirements"):
                            self.entries[entry.key] = _element(entry, stated.get(entry.key))
                for entry in mine:
                    if entry.kind in ("instruments", "requirements"):
                        self.entries[entry.key] = self._rows(entry, stated.get(entry.key) or [])
            self._more()
            with ui.element("div").classes("actions"):
                ui.button("Save", on_click=self._save).props("id=save-certificate")
                ui.button("certificate.toml", on_click=self._file).props("outline id=get-certificate-toml")
            self.said = ui.label("").classes("hint").props("role=status")
            self.errors = ui.element("div").props("aria-live=assertive")

    def _rows(self, entry: FormField, values: Sequence[Any]) -> Rows:
        if entry.kind == "instruments":
            rows = [one if isinstance(one, Mapping) else {"name": one} for one in values]
            return Rows("Instrument", _INSTRUMENT, rows)
        return Rows("Requirement", _REQUIREMENT, values, ("sensitivity_deviation", *self.known["parameters"]))

    def _more(self) -> None:
        """The result before an adjustment, and the laboratory's own files."""
        others = {str(one.path): one.name for one in self.user.results if one.path != self.named.path}
        own = self.named.stated
        value = str(own.before) if own and str(own.before) in others else None
        with frame.group("Adjustment, logo and template", 4):
            self.before = _plain(ui.select({None: "none", **others}, value=value, label="Before adjustment"))
            for kind in _OWN:
                self._own(kind)

    def _own(self, kind: str) -> None:
        """One of the laboratory's own files: to choose, and to remove."""
        words, endings = _OWN[kind]

        async def keep(event: events.UploadEventArguments) -> None:
            self.user.session.keep_own(kind, await event.file.read())
            here.visible = True

        def remove() -> None:
            self.user.session.keep_own(kind, b"")
            here.visible = False

        with ui.element("div"):
            chosen = ui.upload(
                label=f"{kind.capitalize()}: {words}", auto_upload=True, max_file_size=_MOST_OWN, on_upload=keep
            )
            chosen.classes("uploader").props(f'flat bordered accept="{endings}"')
            chosen.on("uploaded", js_handler=f"() => vibrident.sent({chosen.id})")
            with ui.element("div").classes("actions") as here:
                ui.label(f"The {kind} is here.").classes("hint").props("role=status")
                ui.button(f"Remove the {kind}", on_click=remove).props("flat")
            here.visible = self.user.session.own(kind) is not None
        ui.run_javascript(f"vibrident.name({chosen.id}, 'Choose the {kind}', '{kind.capitalize()}')")

    async def _remembered(self) -> dict[str, Any]:
        """The laboratory's part as the browser has it; a logo or template is taken up where there is none."""
        with suppress(TimeoutError, ValueError, binascii.Error, InputError):
            kept = json.loads(await ui.run_javascript("localStorage.vibridentLaboratory ?? '{}'", timeout=5.0))
            if isinstance(kept, dict):
                for kind in _OWN:
                    content = base64.b64decode(str(kept.pop(kind, "")), validate=True)
                    if 0 < len(content) <= _MOST_OWN and self.user.session.own(kind) is None:
                        self.user.session.keep_own(kind, content)
                profile = {key: value for key, value in kept.items() if key in _PROFILE}
                return dict(certificate_section(profile, "remembered profile"))
        return {}

    def _read(self) -> CertificateData:
        """What is in the form, checked; None for what the result states and the form leaves empty."""
        filled = {}
        for entry in form():
            value = _text(self.entries[entry.key].value)
            paragraphs = entry.kind == "paragraphs" and value
            filled[entry.key] = [line for line in value.split("\n") if line.strip()] if paragraphs else value
        filled = {key: value for key, value in filled.items() if value not in (None, [])}
        if len(json.dumps(filled)) > _MOST_TEXT:
            raise InputError(
                "The entries are too long.",
                expected=f"at most {_MOST_TEXT} characters in all",
                found="more",
                where="certificate",
                remedy="shorten them",
            )
        section = certificate_section(filled, "what the certificate states")
        sensor = {key: element.value.strip() or None for key, element in self.of_sensor.items()}
        chosen = next((one.path for one in self.user.results if str(one.path) == self.before.value), None)
        return CertificateData(
            {**dict.fromkeys(self.known["certificate"]), **section},
            {key: text for key, text in sensor.items() if text != (self.known["sensor"].get(key) or None)},  # type: ignore[arg-type]
            before=chosen,
        )

    async def _save(self) -> bool:
        self.errors.clear()
        self.said.text = ""
        try:
            self.user.require("identify", "state what a certificate says")
            self.named.stated = stated = self._read()
        except Exception as error:
            frame.show_error(self.errors, error, self.user.session)
            return False
        self.user.changed()
        self._say()
        profile = {key: stated.certificate[key] for key in _PROFILE if stated.certificate.get(key)}
        own = {kind: self.user.session.own(kind) for kind in _OWN}
        profile |= {kind: base64.b64encode(path.read_bytes()).decode() for kind, path in own.items() if path}
        ui.run_javascript(f"localStorage.vibridentLaboratory = {json.dumps(json.dumps(profile))}")
        self.said.text = "Saved: reports and exports of this result state it."
        return True

    async def _file(self) -> None:
        if await self._save():
            ui.download.content(certificate_text(self.given()), "certificate.toml")


class Rows:
    """Entries of several values each, with a button for one more."""

    def __init__(
        self, name: str, labels: Mapping[str, str], values: Sequence[Mapping[str, Any]], choices: Sequence[str] = ()
    ) -> None:
        self.name, self.labels, self.choices = name, labels, choices
        self.rows: list[dict[str, Any]] = []
        self.place = ui.element("div").classes("w-full")
        for value in values:
            self.add(value)
        ui.button(f"Add {name.lower()}", on_click=lambda: self.add({})).props("outline")

    def add(self, value: Mapping[str, Any]) -> None:
        """One more row; one without its first entry is none."""
        row: dict[str, Any] = {}
        with self.place, frame.group(f"{self.name} {len(self.rows) + 1}", 0):
            for key, label in self.labels.items():
                known = value.get(key)
                if key == "quantity":
                    element = ui.select(list(self.choices), value=known if known in self.choices else None, label=label)
                elif key in _NUMBERS:
                    element = ui.number(label, value=known)
                else:
                    element = ui.input(label, value="" if known is None else str(known))
                row[key] = _plain(element, date=key == "calibrated_until")
            button = ui.button(icon="close", on_click=partial(self._empty, row)).props("flat round size=sm")
            button.props["aria-label"] = f"remove {self.name.lower()} {len(self.rows) + 1}"
        self.rows.append(row)

    def _empty(self, row: dict[str, Any]) -> None:
        self.rows.remove(row)
        next(iter(row.values())).parent_slot.parent.delete()

    @property
    def value(self) -> list[dict[str, Any]]:
        """The rows that are filled in."""
        found = [{key: _text(element.value) for key, element in row.items()} for row in self.rows]
        stated = [{key: value for key, value in row.items() if value is not None} for row in found]
        return [row for row in stated if row]


def _element(entry: FormField, known: Any) -> Any:
    unit = _UNITS.get(entry.key.rpartition("_")[2]) if entry.kind == "number" else None
    label = entry.label + (f", {unit}" if unit else "") + (" *" if entry.required else "")
    if entry.kind == "number":
        return _plain(ui.number(label, value=known, format="%.12g"))
    if entry.kind == "choice":
        choices = {None: "not stated", **{one: _LANGUAGES.get(one, one) for one in entry.choices}}
        return _plain(ui.select(choices, value=known, label=label))
    text = "\n".join(known) if isinstance(known, list) else "" if known is None else str(known)
    if entry.kind in ("lines", "paragraphs"):
        return _plain(ui.textarea(label, value=text).props("autogrow rows=1"))
    return _plain(ui.input(label, value=text), date=entry.kind == "date")


def _text(value: Any) -> Any:
    return value.strip() or None if isinstance(value, str) else value


def _plain(element: Any, *, date: bool = False) -> Any:
    return element.props("dense outlined stack-label" + (" type=date" if date else ""))

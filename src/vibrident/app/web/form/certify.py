"""Build the form of what a certificate states; the laboratory's part comes from its profile."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.form.entries import PLAIN, RowEntries, entered, entry
from vibrident.app.web.laboratories import LABORATORY_FILES
from vibrident.app.web.language import page_language, phrase, translate
from vibrident.app.web.state import NamedResult
from vibrident.app.web.user import User
from vibrident.app.web.words import LABELS
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, GivenFields
from vibrident.data.io.calibration_file import SensorSection
from vibrident.data.io.certificate import (
    CertificateData,
    CertificateSection,
    certificate_section,
    certificate_text,
    check_dates,
)
from vibrident.data.io.keys import keys_of
from vibrident.physics.naming import in_words
from vibrident.show.issue import FormField, form, lacking
from vibrident.show.language import ENGLISH
from vibrident.show.report import name_of_sensor

#: What an entry of a list is called.
ENTRY_NAMES = {"instruments": phrase("Instrument"), "requirements": phrase("Requirement")}
_MAX_ENTRY_CHARACTERS = 100_000  # most characters of all entries
_KEYS = keys_of(CertificateSection)
_SENSOR = [key for name, key in keys_of(SensorSection).items() if name != "model"]


class CertificateForm:
    """The form of one result's certificate.

    ``states``: what the result itself states: ``certificate``, ``sensor``, and the names of its
    ``parameters``.
    """

    def __init__(self, user: User, named: NamedResult, states: GivenFields) -> None:
        self.user = user
        self.named = named
        self.states = states
        self._apply_profile()
        self.entries: Fields = {}
        self.sensor_entries: Fields = {}

    def _apply_profile(self) -> None:
        """State what the chosen profile states, for a result that was made here."""
        if self.named.stated is None and self.named.request is not None and self.user.profile:
            result_keys = self.states["certificate"]
            from_profile = {
                key: v for key, v in self._read_profile().items() if key not in result_keys
            }
            self.named.stated = CertificateData(from_profile)
            self.user.changed()

    def build(self) -> None:
        """Build the list of missing entries, and the form, whose entries are built when opened."""
        self.lacking = frame.hint("").props("role=status id=lacking")
        self._show_missing()
        if not self.user.may("identify"):
            return
        self.expansion = (
            ui.expansion(translate(LABELS["export.certificate"]))
            .classes("w-full")
            .props("id=certificate")
        )
        self.expansion.on_value_change(self._open)

    def stated_data(self) -> CertificateData:
        """Return what is stated beside the result, with logo and template."""
        statements = self.named.stated or CertificateData()
        before = statements.before if statements.before and statements.before.exists() else None
        return replace(
            statements,
            before=before,
            **{kind: self.user.session.laboratory_file(kind) for kind in LABORATORY_FILES},
        )

    def name_of_file(self, name: str) -> str:
        """Return the name under which the browser saves a document, with sensor and date."""
        certificate, sensor = self._statements()
        return name_of_sensor(name, sensor, certificate)

    def _statements(self) -> tuple[Fields, Fields]:
        statements = self.named.stated or CertificateData()
        return {**self.states["certificate"], **statements.certificate}, {
            **self.states["sensor"],
            **statements.sensor,
        }

    def _show_missing(self) -> None:
        missing = lacking(*self._statements())
        names = ", ".join(translate(str(ENGLISH("label", key))) for key in missing)
        self.lacking.text = (
            translate("The PDF is a draft until these are stated: {names}.", names=names)
            if missing
            else translate("Nothing is missing in the PDF.")
        )

    async def _open(self) -> None:
        if not self.expansion.value or self.entries:
            return
        entries, sensor = self._statements()
        entries = self._read_profile() | {
            key: value for key, value in entries.items() if value is not None
        }
        with self.expansion:
            frame.hint(
                translate(
                    "* is asked for by ISO/IEC 17025:2017, 7.8. What is the same on each of the "
                    "laboratory's certificates comes from its profile."
                )
            )
            fields = form(page_language().code)
            with frame.add_group(translate("Object"), 4):
                for key in _SENSOR:
                    label = translate(key.label) + (" *" if key.name == "serial_number" else "")
                    self.sensor_entries[key.name] = entry(key, sensor.get(key.name), label=label)
            for title in dict.fromkeys(field.group for field in fields):
                self._build_group(
                    title, [field for field in fields if field.group == title], entries
                )
            self._build_adjustment()
            with frame.actions():
                frame.add_button(translate("Save"), self._save, "id=save-certificate")
                frame.add_button(
                    translate("Save as a file"), self._save_file, "outline id=get-certificate-toml"
                )
            self.status = frame.hint("").props("role=status")
            self.errors = frame.add_error_area()

    def _build_group(
        self, title: str, fields: Sequence[FormField], given_values: GivenFields
    ) -> None:
        """Build the entries below a heading of the certificate."""
        lists = {field.key: field for field in fields if _KEYS[field.key].kind == "entries"}
        with frame.add_group(title, 4):
            for field in fields:
                if field.key not in lists:
                    key = replace(_KEYS[field.key], title=field.label)
                    label = key.label + (" *" if field.required else "")
                    self.entries[field.key] = entry(key, given_values.get(field.key), label=label)
        for name in lists:
            section = _KEYS[name].section
            values = given_values.get(name) or []
            names = {name: translate(in_words(name)) for name in self.states["parameters"]}
            words = {"sensitivity_deviation": translate("deviation of the sensitivity"), **names}
            self.entries[name] = RowEntries(
                ENTRY_NAMES[name],
                [*keys_of(section).values()] if section else [],
                [value if isinstance(value, Mapping) else {"name": value} for value in values],
                options={"quantity": words},
            )

    def _build_adjustment(self) -> None:
        """Build the choice of the result before an adjustment."""
        other_results = {
            str(named.path): named.name
            for named in self.user.results
            if named.path != self.named.path
        }
        statements = self.named.stated
        before = str(statements.before) if statements else ""
        value = before if before in other_results else None
        with frame.add_group(translate("Adjustment"), 4):
            choices = {None: translate("none"), **other_results}
            label = translate("Before adjustment")
            self.before = ui.select(choices, value=value, label=label).props(PLAIN)

    def _read_profile(self) -> Fields:
        """Return what the chosen profile states."""
        with suppress(InputError):  # said where the profile is chosen
            return dict(self.user.users.laboratories.read(self.user.profile)["certificate"])
        return {}

    def _read_form(self) -> CertificateData:
        """Return the checked form; None for entries of the result that the form leaves empty."""
        entered_values = entered(self.entries, _KEYS)
        if len(json.dumps(entered_values)) > _MAX_ENTRY_CHARACTERS:
            raise InputError(
                "The entries are too long.",
                expected=f"at most {_MAX_ENTRY_CHARACTERS} characters in all",
                found="more",
                where="certificate",
                remedy="shorten them",
            )
        section = certificate_section(entered_values, "what the certificate states")
        sensor_keys = self.states["sensor"]
        texts = {
            name: element.value.strip() or None for name, element in self.sensor_entries.items()
        }
        sensor: Any = {
            name: text for name, text in texts.items() if text != (sensor_keys.get(name) or None)
        }
        paths = (named.path for named in self.user.results)
        before = next((path for path in paths if str(path) == self.before.value), None)
        check_dates(section, "what the certificate states")
        certificate = {**dict.fromkeys(self.states["certificate"]), **section}
        return CertificateData(certificate, sensor, before=before)

    async def _save(self) -> bool:
        self.status.text = ""
        with frame.reporting(self.errors, self.user):
            self.user.require("identify", "state what a certificate says")
            self.named.stated = self._read_form()
            self.user.changed()
            self._show_missing()
            self.status.text = translate("Saved: reports and exports of this result state it.")
            return True
        return False

    async def _save_file(self) -> None:
        if await self._save():
            ui.download.content(certificate_text(self.stated_data()), "certificate.toml")

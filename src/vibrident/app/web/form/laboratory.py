"""Build the third step: the laboratory, its instruments, and the sources of uncertainty."""

from __future__ import annotations

import datetime
from dataclasses import replace
from typing import Any

from nicegui import events, ui

from vibrident.app.web import frame
from vibrident.app.web.fit import FitStep
from vibrident.app.web.form.description import ENTRIES, ENTRY_NAMES, SECTIONS
from vibrident.app.web.form.entries import PLAIN, RowEntries, entered, entry
from vibrident.app.web.form.sources import applies, entry_in_file, entry_in_form, source_keys
from vibrident.app.web.laboratories import LABORATORY_FILES, MAX_LABORATORY_FILE_BYTES
from vibrident.app.web.language import page_language, phrase, translate
from vibrident.app.web.user import User
from vibrident.base.fields import Fields, GivenFields
from vibrident.data.io.certificate import CertificateSection
from vibrident.data.io.keys import keys_of
from vibrident.data.io.laboratory import LABORATORY_KEYS
from vibrident.show.issue import form

_KEYS = keys_of(CertificateSection)
#: Lists of a calibration file that a profile holds, too.
_LISTS = ("uncertainty", "cmc")


#: File of a laboratory → label and button of its upload, what is said of one that is here, the
#: button that removes it, and the endings that are accepted.
_FILE_LABELS = {
    "logo": (
        *(phrase("Logo: PNG, JPEG or SVG"), phrase("Choose the logo")),
        *(phrase("The logo is here."), phrase("Remove the logo"), ".png,.jpg,.jpeg,.svg"),
    ),
    "template": (
        *(phrase("Template: a typst file in place of ours"), phrase("Choose the template")),
        *(phrase("The template is here."), phrase("Remove the template"), ".typ"),
    ),
}
_SOON_DAYS = 30  # days before an instrument is due from which it is named


class LaboratoryStep:
    """The section of the sources of the present calibration and of the profile they come from."""

    def __init__(self, user: User, fit: FitStep) -> None:
        self.user = user
        self.fit = fit

    def build(self) -> None:
        """Build the section, hidden until there are data or results."""
        self.section = frame.add_step(translate("Laboratory and uncertainty"), "laboratory")
        with self.section:
            self.body = ui.element("div")
        self.section.visible = False

    @property
    def states_nothing(self) -> bool:
        """Return whether the form is used, and states no uncertainty of the measuring chain."""
        columns_form = self.user.applicable_form
        return columns_form is not None and not (
            columns_form.get("uncertainty") or columns_form.get("reference.standard_uncertainty")
        )

    def show(self) -> None:
        """Show the profile and the sources for the data that there are now."""
        self.section.visible = not self.user.empty
        self.body.clear()
        if self.user.empty or not self.user.may("identify"):
            self.section.visible = False
            return
        with self.body:
            self.errors = frame.add_error_area()
            profile = self._read_profile()
            self._apply_profile(profile)
            self._build_choice()
            self._show_due_instruments(profile["certificate"].get("instruments") or ())
            self._build_sources(profile)
            self._build_laboratory(profile["certificate"])
            self._build_buttons()

    def _read_profile(self) -> Fields:
        laboratories = self.user.users.laboratories
        try:
            return laboratories.read(self.user.profile)
        except Exception as error:
            frame.show_error(self.errors, error, self.user.session)
            return laboratories.read("")

    def _apply_profile(self, profile: GivenFields) -> None:
        """Set the form's lists to the profile's, unless the user has changed them."""
        if (columns_form := self.user.applicable_form) is None or not self.user.profile:
            return
        for name in _LISTS:
            if name not in columns_form.touched and columns_form.get(name) != profile[name]:
                columns_form.description.set(name, profile[name])
                self.fit.refresh()

    def _build_choice(self) -> None:
        names = {
            "": translate("none"),
            **{name: name for name in self.user.users.laboratories.names},
        }
        selected = self.user.profile if self.user.profile in names else ""
        with ui.element("div").classes("fields wide"):
            choice = ui.select(names, value=selected, label=translate("Laboratory profile"))
            choice.props(f"{PLAIN} id=profile").on_value_change(self._select)
        frame.hint(
            translate(
                "A profile keeps what is the same on each calibration: sources of uncertainty, "
                "name and address, instruments. It lies on the server, for all who use this page."
            )
        )

    def _select(self, event: events.ValueChangeEventArguments) -> None:
        """Replace sources and files by those of a profile."""
        user = self.user
        name = str(event.value or "")
        user.profile = name
        if user.form is not None:
            user.form.touched -= {*_LISTS}
        for kind in LABORATORY_FILES:
            user.session.keep_laboratory_file(
                kind, user.users.laboratories.file_content(name, kind)
            )
        user.changed()
        self.show()

    def _show_due_instruments(self, instruments: Any) -> None:
        """Name the instruments whose calibration has ended, or ends soon."""
        today = datetime.date.today()
        dates = [
            (datetime.date.fromisoformat(instrument["calibrated_until"]), instrument["name"])
            for instrument in instruments
            if instrument.get("calibrated_until")
        ]
        for date, name in sorted(dates):
            days = (date - today).days
            if days < 0:
                label = ui.label(
                    translate("{name}: its calibration ended on {date}.", name=name, date=date)
                )
                label.classes("warning").props("role=status")
            elif days <= _SOON_DAYS:
                due = translate("{name}: to be calibrated by {date}.", name=name, date=date)
                frame.hint(due)

    def _build_sources(self, profile: GivenFields) -> None:
        """Build the lists of the form; without one, those of the profile."""
        columns_form = self.user.applicable_form
        if self.user.session.names and columns_form is None:
            ui.label(
                translate("The sources are those of the calibration file that came with the data.")
            )
        self.lists: dict[str, RowEntries] = {}
        for name in _LISTS:
            values = profile[name] if columns_form is None else columns_form.get(name) or []
            with ui.element("div").classes("w-full").props(f"id={name}"):
                frame.heading(translate(SECTIONS[name].label))
                keys = ENTRIES[name]
                conversion: Fields = {}
                if name == "uncertainty":
                    keys = source_keys()
                    conversion = {"to_form": entry_in_form, "to_file": entry_in_file}
                    conversion |= {"applies": applies, "rare": ("from_c", "to_c")}
                rows = RowEntries(ENTRY_NAMES[name], keys, values, **conversion)
                rows.on_change = lambda name=name, rows=rows: self._set_list(name, rows.value)
            self.lists[name] = rows

    def _set_list(self, name: str, value: Any) -> None:
        if (columns_form := self.user.applicable_form) is None or columns_form.get(name) == value:
            return
        columns_form.set(name, value)
        self.user.changed()
        self.fit.refresh()

    def _build_laboratory(self, values: GivenFields) -> None:
        """Build the entries that all certificates of a laboratory share."""
        self.entries: Fields = {}
        expansion = ui.expansion(translate("Name, address, instruments, logo")).classes("w-full")
        expansion.props("id=laboratory-data")
        fields = {
            field.key: field for field in form(page_language().code) if field.key in LABORATORY_KEYS
        }
        with expansion:
            with frame.add_group(translate("Name and address")):
                for name in (name for name in fields if _KEYS[name].kind != "entries"):
                    key = replace(_KEYS[name], title=fields[name].label)
                    self.entries[name] = entry(key, values.get(name), label=key.label)
            section = _KEYS["instruments"].section
            assert section is not None
            frame.heading(translate("Instruments"))
            instruments = values.get("instruments") or []
            rows = RowEntries("Instrument", [*keys_of(section).values()], instruments)
            self.entries["instruments"] = rows
            for kind in LABORATORY_FILES:
                self._build_file_choice(kind)

    def _build_file_choice(self, kind: str) -> None:
        """Build the upload of one of the laboratory's own files, and a button to remove it."""
        *words, endings = _FILE_LABELS[kind]
        label, choose, stored, remove_label = map(translate, words)

        async def keep(event: events.UploadEventArguments) -> None:
            self.user.session.keep_laboratory_file(kind, await event.file.read())
            stored_row.visible = True

        def remove() -> None:
            self.user.session.keep_laboratory_file(kind, b"")
            stored_row.visible = False

        with ui.element("div"):
            upload = ui.upload(
                label=label,
                auto_upload=True,
                max_file_size=MAX_LABORATORY_FILE_BYTES,
                on_upload=keep,
            )
            frame.style_upload(upload).props(f'accept="{endings}"')
            with frame.actions() as stored_row:
                frame.hint(stored).props("role=status")
                frame.add_button(remove_label, remove, "flat")
            stored_row.visible = self.user.session.laboratory_file(kind) is not None
        frame.name_upload(upload, choose, label.partition(":")[0])

    def _build_buttons(self) -> None:
        with frame.actions():
            self.name = ui.input(translate("Name of the profile"), value=self.user.profile).props(
                PLAIN
            )
            frame.add_button(translate("Save the profile"), self._save, "outline id=save-profile")
            if self.user.profile:
                frame.add_button(
                    translate("Remove the profile"), self._remove, "flat id=remove-profile"
                )
        self.status = frame.hint("").props("role=status id=profile-said")

    @frame.reported
    async def _save(self) -> None:
        user = self.user
        user.require("identify", "change a laboratory's profile")
        certificate = entered(self.entries, _KEYS)
        lists = {name: rows.value for name, rows in self.lists.items()}
        paths = {kind: user.session.laboratory_file(kind) for kind in LABORATORY_FILES}
        files = {kind: path.read_bytes() for kind, path in paths.items() if path is not None}
        profile_name = (self.name.value or "").strip() or str(certificate.get("laboratory") or "")
        profile = {"certificate": certificate, **lists}
        user.profile = user.users.laboratories.write(profile_name, profile, files)
        await user.note("saved a laboratory's profile", name=user.profile)
        user.changed()
        name = user.profile
        self.show()
        message = "Saved as “{name}”: new calibrations and certificates begin with it."
        self.status.text = translate(message, name=name)

    @frame.reported
    async def _remove(self) -> None:
        self.user.require("identify", "remove a laboratory's profile")
        self.user.users.laboratories.remove(self.user.profile)
        await self.user.note("removed a laboratory's profile", name=self.user.profile)
        self.user.profile = ""
        self.user.changed()
        self.show()

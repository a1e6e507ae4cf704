"""Build the second step: the user confirms the guessed meaning of the columns."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.column_guess import ColumnGuess, guess
from vibrident.app.web.data import DataStep
from vibrident.app.web.fit import FitStep
from vibrident.app.web.form.description import (
    ENTRIES,
    ENTRY_NAMES,
    KEYS,
    NEEDED,
    ROLES,
    SECTIONS,
    calibration_text,
    describe_guess,
)
from vibrident.app.web.form.entries import PLAIN, RowEntries, entry, filled
from vibrident.app.web.form.known import KnownResponses
from vibrident.app.web.form.laboratory import LaboratoryStep
from vibrident.app.web.form.written import edit_as_text
from vibrident.app.web.language import page_language, phrase, translate
from vibrident.app.web.preview import CHART_HEIGHT_PX
from vibrident.app.web.sandboxed import (
    MAX_TEXT_LENGTH,
    draw_chart,
    find_faults,
    read_calibration_text,
    require_readable,
)
from vibrident.app.web.session import CALIBRATION
from vibrident.app.web.state import ConfirmedCalibration, Form
from vibrident.app.web.user import User
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields
from vibrident.physics.models import ADD_ONS, CORES

#: Sections that share the heading of the first one.
_GROUPS = (
    ("reference", "interferometer"),
    ("response",),
    ("sampling", "records"),
    ("table",),
    ("sensor", "mounting"),
)
_NAME_PART = phrase("Reference files: more in names")
_GUESSED = "Guessed from the names in {file} and the motion. Please check."
_GUESSED_AGAIN = (
    "Guessed from the names in {file} and the motion; your settings are kept. Please check."
)
_TOO_MANY_COLUMNS = (
    "The file has {number} columns: enter the name or number of each that is needed. The first are "
    "{names}."
)


class _Outdated(Exception):
    """The files changed while the form was built, or the page was left."""


class ColumnsStep:
    """The section from files to a calibration file in the user's folder."""

    def __init__(
        self, user: User, data: DataStep, laboratory: LaboratoryStep, fit: FitStep
    ) -> None:
        self.user = user
        self.data = data
        self.laboratory = laboratory
        self.fit = fit
        self.version = 0  # of the content; increases whenever it is replaced

    def build(self) -> None:
        """Build the section, hidden until there are data."""
        self.section = frame.add_step(translate("Columns, units and model"), "columns")
        with self.section:
            self.body = ui.element("div")
        self.section.visible = False

    async def show(self) -> None:
        """Guess again after the files have changed, or use the uploaded calibration file."""
        self.fit.withdraw_confirmation()
        self.user.session.forget_calibration()
        if await self._update(guess_again=True):
            frame.scroll_to(self.section)

    async def restore(self) -> None:
        """Show the user's earlier state."""
        await self._update(guess_again=False)

    async def _update(self, *, guess_again: bool) -> bool:
        """Replace the content and the sources; return whether there is something to confirm."""
        confirmable = await self._update_content(guess_again=guess_again)
        if not self.body.is_deleted:
            self.laboratory.show()
        return confirmable

    async def _update_content(self, *, guess_again: bool) -> bool:
        self.version += 1
        version = self.version
        session = self.user.session
        self.body.clear()
        self.section.visible = bool(session.names)
        if not session.names:
            self.user.form = None
            return False
        with self.body, frame.actions():
            ui.spinner(size="28px")
            ui.label(translate("Looking at the files …")).props("role=status")
        name = session.calibration
        try:
            text = await self._read_files(guess_again=guess_again)
        except Exception as error:
            if version == self.version:
                frame.show_error(self.body, error, session)
            return False
        if self._is_outdated(version):
            return False
        self.body.clear()
        with self.body, contextlib.suppress(_Outdated):
            if name is None:
                await self._build_form()
            else:
                self._show_calibration_file(name, text)
                with frame.reporting(self.errors, self.user):
                    await self.user.run_sandboxed(require_readable, session.data, name)
            return True
        return False

    def _is_outdated(self, version: int) -> bool:
        """Return whether the content was replaced since this version, or the page was left."""
        return version != self.version or self.body.is_deleted

    async def _read_files(self, *, guess_again: bool) -> str:
        """Return the text of the calibration file; without one, guess the columns for the form."""
        session = self.user.session
        version = self.version
        if not session.files:
            raise InputError(
                "There is a calibration file, but no data.",
                expected="the files that it names",
                found="none",
                where="upload",
                remedy="add them",
            )
        if session.calibration is not None:
            return await self.user.run_sandboxed(
                read_calibration_text, session.data, session.calibration
            )
        if guess_again or self.user.form is None:
            guessed = await self.user.run_sandboxed(
                guess, session.data, session.files, page_language().code
            )
            if version == self.version:
                self.user.form = merge_guess(self.user.form, guessed)
                self.user.changed()
        return ""

    def _show_calibration_file(self, name: str, text: str) -> None:
        frame.hint(translate("{file} came with the data and describes the columns:", file=name))
        frame.Text("calibration-came", translate("Calibration file"), text)
        self.errors = frame.add_error_area()
        with frame.actions():
            confirmed = ConfirmedCalibration(name, from_form=False)
            frame.add_button(translate("Confirm"), lambda: self.fit.show(confirmed), "id=confirm")
            if len(text) <= MAX_TEXT_LENGTH:
                frame.add_button(
                    translate("Edit"), lambda: self._show_editor(name, text), "outline id=edit-text"
                )

    @frame.reported
    def _edit_as_text(self) -> None:
        """Edit the form as a calibration file, which can state more than the form asks."""
        text = calibration_text(self.form.description, self.user.session.files)
        self._show_editor(CALIBRATION, text)

    def _show_editor(self, name: str, text: str) -> None:
        """Replace the content by an editor of a calibration file."""
        self.version += 1
        self.body.clear()
        with self.body:
            edit_as_text(self.user, name, text, self._on_text_used, self.restore)

    async def _on_text_used(self) -> None:
        self.data.show()
        await self.show()

    async def _build_form(self) -> None:
        assert self.user.form is not None
        self.form = form = self.user.form
        self.elements: Fields = {}
        self.groups: list[tuple[ui.element, list[str]]] = []
        first_file = self.user.session.files[0]
        frame.hint(translate(_GUESSED_AGAIN if form.touched else _GUESSED, file=first_file))
        guessed = form.guess
        if guessed.all_columns > len(guessed.columns.columns):
            names = frame.list_names(guessed.columns.labels)
            frame.hint(translate(_TOO_MANY_COLUMNS, number=guessed.all_columns, names=names))
        kinds = {False: translate("Records in time"), True: translate("Table of a response")}
        kind = ui.toggle(kinds, value=form.description.table).props("no-caps")
        kind.on_value_change(lambda event: self._set("table", event.value))
        for sections in _GROUPS:
            await self._build_group(sections, "basic", heading_level=3)
        self.rare_keys = ui.expansion(translate("More that a calibration file can state"))
        self.rare_keys.classes("w-full").props("id=more-keys").on_value_change(self._open_rare_keys)
        with frame.actions():
            frame.add_button(translate("Draw these columns"), self._draw_columns, "outline id=show")
        self.plot = ui.element("div").classes("chart")
        self.chart: frame.ChartView | None = None
        self.faults = ui.element("div").props("aria-live=polite id=faults")
        self.errors = frame.add_error_area()
        with frame.actions():
            frame.add_button(translate("Confirm"), self._confirm, "id=confirm")
            frame.add_button(translate("Edit as text"), self._edit_as_text, "outline id=edit-text")
        if guessed.chart and not form.touched:
            self._show_chart(guessed.chart)
            await self._show_faults()
        else:
            await self._draw_columns()

    def _show_chart(self, figure: bytes) -> None:
        if self.chart is not None:
            self.chart.show(figure)
            return
        with self.plot:
            self.chart = frame.ChartView(figure, CHART_HEIGHT_PX)
            first_file = self.user.session.files[0]
            frame.hint(translate("{file}, the beginning of the file as it is.", file=first_file))

    async def _open_rare_keys(self) -> None:
        """Build the entries for rare keys when they are opened for the first time."""
        if not self.rare_keys.value or self.rare_keys.default_slot.children:
            return
        with self.rare_keys, contextlib.suppress(_Outdated):
            sections = [section for group in _GROUPS for section in group]
            await self._build_group(sections, "more", heading_level=4)
            self._build_record_entries()
            known_responses = KnownResponses(self.user, self._set, self.data.show)
            self.groups += [
                (container, [path]) for path, container in known_responses.elements.items()
            ]
            self._update_visibility()

    async def _build_group(
        self, sections: Sequence[str], level: str, *, heading_level: int
    ) -> None:
        """Build the entries for the keys of ``level`` in some sections."""
        paths = [
            path
            for path, key in KEYS.items()
            if path.partition(".")[0] in sections and key.level == level
        ]
        if not paths:
            return
        title = SECTIONS[sections[0]].label if level == "basic" else phrase("Channels and records")
        with (
            ui.element("div").classes("w-full") as container,
            frame.add_group(translate(title), heading_level),
        ):
            self.groups.append((container, paths))
            self._update_visibility()
            for path in paths:
                if path == "sensor.model":
                    self._build_model_choice()
                else:
                    await self._build_entry(path)
            if "records.excitation" in paths and len(self.user.session.files) > 1:
                value = self.form.description.optical_part
                example = translate("such as _ref")
                part = ui.input(translate(_NAME_PART), value=value, placeholder=example)
                part.props(PLAIN).on_value_change(
                    lambda event: self._set("optical_part", event.value or "")
                )

    async def _build_entry(self, path: str) -> None:
        """Build the entry of a key.

        Other users get a turn after it, because a form has many entries.
        """
        key = KEYS[path]
        options = self._column_options(path) if path in ROLES else None
        element = entry(key, self.form.get(path), options=options)
        element.props(f"id={path.replace('.', '-')}")
        element.on_value_change(lambda event: self._set(path, filled(key, event.value)))
        element.visible = self.form.description.applies(path)
        self.elements[path] = element
        version = self.version
        await asyncio.sleep(0)
        if self._is_outdated(version):
            raise _Outdated

    def _set(self, path: str, value: Any) -> None:
        """Set a field of the form to the user's value."""
        form = self.user.form
        if form is None or form.get(path) == value:
            return
        form.set(path, value)
        self.user.changed()
        self._update_visibility()
        self.fit.refresh()

    def _update_visibility(self) -> None:
        applies = self.form.description.applies
        for path, element in self.elements.items():
            element.visible = applies(path)
        for container, paths in self.groups:
            container.visible = any(map(applies, paths))

    def _column_options(self, path: str) -> dict[Any, str] | None:
        """Return the columns to choose from, column → label; None if there are too many."""
        columns = self.form.guess.columns
        if self.form.guess.all_columns > len(columns.columns):
            return None
        options: dict[Any, str] = dict(zip(columns.columns, columns.labels, strict=True))
        if path in NEEDED or KEYS[path].default is ...:
            return options
        return {None: translate("none"), **options}

    def _build_model_choice(self) -> None:
        """Build the choices of the model's core and its add-ons, which are one key."""
        core, *add_ons = (self.form.get("sensor.model") or "").split("+")
        core_choice = ui.select([*CORES], value=core, label=translate("Model"))
        core_choice.props(f"{PLAIN} options-dense id=core")
        add_on_names = [*ADD_ONS, *(name for name in add_ons if ":" in name)]
        add_on_choice = ui.select(
            add_on_names, value=add_ons, label=translate("Add-ons"), multiple=True
        )
        add_on_choice.props(f"{PLAIN} options-dense use-chips id=add-ons")

        def set_model() -> None:
            self._set("sensor.model", "+".join((core_choice.value, *add_on_choice.value)))

        core_choice.on_value_change(set_model)
        add_on_choice.on_value_change(set_model)

    def _build_record_entries(self) -> None:
        """Build the entries for files that differ from the others."""
        files = {file: file for file in self.user.session.files}
        keys = [key for key in ENTRIES["records"] if key.name != "reference_file"]
        values = self.form.get("different") or []
        with ui.element("div").classes("w-full") as container:
            frame.heading(translate("Records that differ"), 4)
            rows = RowEntries(ENTRY_NAMES["records"], keys, values, options={"file": files})
            rows.on_change = lambda: self._set("different", rows.value)
        self.groups.append((container, ["records"]))
        self._update_visibility()

    async def _draw_columns(self) -> None:
        container = self.plot
        figure = await self._run_on_form(draw_chart, self.errors, page_language().code)
        if figure is not None and container is self.plot and not container.is_deleted:
            self._show_chart(figure)
            await self._show_faults()

    async def _show_faults(self) -> None:
        """Show what an identification would refuse in each file."""
        container = self.faults
        faults = await self._run_on_form(find_faults, container)
        if faults and not container.is_deleted:
            errors = [InputError(**fields) for fields in faults]
            frame.show_faults(container, errors, self.user.session)

    async def _run_on_form(
        self, function: Callable[..., Any], errors: ui.element, *arguments: Any
    ) -> Any:
        """Run a sandboxed function of form and files; None after an error or without a form."""
        form = self.user.form
        session = self.user.session
        if form is None:
            return None
        with frame.reporting(errors, self.user):
            return await self.user.run_sandboxed(
                function, form.description, session.data, session.files, *arguments
            )

    @frame.reported
    async def _confirm(self) -> None:
        form = self.user.form
        if form is None:
            return
        calibration_text(form.description, self.user.session.files)
        await self.fit.show(ConfirmedCalibration(CALIBRATION, from_form=True))
        if self.laboratory.states_nothing:
            frame.scroll_to(self.laboratory.section)


def merge_guess(before: Form | None, guessed: ColumnGuess) -> Form:
    """Return the form of a new guess, with the user's settings of columns that still exist."""
    description = describe_guess(
        guessed.columns, guessed.excitation or "sine", guessed.optical_part
    )
    if before is None or not before.touched:
        return Form(guessed, description)
    for path in ROLES:
        is_guessable = before.description.get(path) in (None, *guessed.columns.columns)
        if path not in before.touched and not is_guessable:
            before.description.set(path, description.get(path))
    return Form(guessed, before.description, before.touched)

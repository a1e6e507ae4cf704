"""Build the second step: the meaning of the columns, guessed and drawn, for the user to confirm."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
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
from vibrident.app.web.language import phrase, say, spoken
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
from vibrident.data.io.keys import Key
from vibrident.physics.models import ADD_ONS, CORES

#: Sections that are asked for below one heading, the first one's.
_GROUPS = (
    ("reference", "interferometer"),
    ("response",),
    ("sampling", "records"),
    ("table",),
    ("sensor", "mounting"),
)
_NAME_PART = phrase("Reference files: more in names")


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
        self.turn = 0

    def build(self) -> None:
        """Build the section, hidden until there are data."""
        self.section = frame.add_step(say("Columns, units and model"), "columns")
        with self.section:
            self.body = ui.element("div")
        self.section.visible = False

    async def show(self) -> None:
        """Guess again after the files have changed, or use the uploaded calibration file."""
        self.fit.withdraw_confirmation()
        self.user.session.forget_calibration()
        if await self._look(again=True):
            frame.scroll_to(self.section)

    async def restore(self) -> None:
        """Show the user's earlier state."""
        await self._look(again=False)

    async def _look(self, *, again: bool) -> bool:
        """Update the form and the sources; return whether there is something to confirm."""
        confirmable = await self._guess(again=again)
        if not self.body.is_deleted:
            self.laboratory.show()
        return confirmable

    async def _guess(self, *, again: bool) -> bool:
        self.turn += 1
        turn = self.turn
        session = self.user.session
        self.body.clear()
        self.section.visible = bool(session.names)
        if not session.names:
            self.user.form = None
            return False
        with self.body, frame.actions():
            ui.spinner(size="28px")
            ui.label(say("Looking at the files …")).props("role=status")
        try:
            if not session.files:
                raise InputError(
                    "There is a calibration file, but no data.",
                    expected="the files that it names",
                    found="none",
                    where="upload",
                    remedy="add them",
                )
            name = session.calibration
            look = self.user.run_sandboxed
            text = "" if name is None else await look(read_calibration_text, session.data, name)
            if name is None and (again or self.user.form is None):
                guessed = await look(guess, session.data, session.files, spoken().code)
                if turn == self.turn:
                    self.user.form = merge_guess(self.user.form, guessed)
                    self.user.changed()
        except Exception as error:
            if turn == self.turn:
                frame.show_error(self.body, error, session)
            return False
        if turn != self.turn or self.body.is_deleted:  # the files changed, or the page was left
            return False
        self.body.clear()
        with self.body:
            if name is not None:
                self._as_it_stands(name, text)
                await frame.run_sandboxed(
                    self.user, self.errors, require_readable, session.data, name
                )
                return True
            with contextlib.suppress(_Outdated):
                await self._ask()
                return True
        return False

    def _as_it_stands(self, name: str, text: str) -> None:
        """Show the uploaded calibration file."""
        came = say("{file} came with the data and describes the columns:", file=name)
        frame.hint(came)
        frame.Text("calibration-came", say("Calibration file"), text)
        self.errors = frame.add_error_area()
        with frame.actions():
            confirm = ui.button(
                say("Confirm"), on_click=lambda: self.fit.show(ConfirmedCalibration(name, False))
            )
            confirm.props("id=confirm")
            if len(text) <= MAX_TEXT_LENGTH:
                edit = ui.button(say("Edit"), on_click=lambda: self._write(name, text))
                edit.props("outline id=edit-text")

    def _edit_as_text(self) -> None:
        """Edit the form as a calibration file, for what the form does not ask."""
        self.errors.clear()
        try:
            assert self.user.form is not None
            text = calibration_text(self.user.form.description, self.user.session.files)
            self._write(CALIBRATION, text)
        except Exception as error:
            frame.show_error(self.errors, error, self.user.session)

    def _write(self, name: str, text: str) -> None:
        """Offer a calibration file to be edited, in place of what is shown."""
        self.turn += 1
        self.body.clear()
        with self.body:
            edit_as_text(self.user, name, text, self._on_text_used, self.restore)

    async def _on_text_used(self) -> None:
        self.data.show()
        await self.show()

    async def _ask(self) -> None:
        assert self.user.form is not None
        self.form = form = self.user.form
        self.elements: dict[str, Any] = {}
        self.groups: list[tuple[ui.element, list[str]]] = []
        first = self.user.session.files[0]
        guessed = "Guessed from the names in {file} and the motion. Please check."
        guessed_around_settings = (
            "Guessed from the names in {file} and the motion; your settings are kept. Please check."
        )
        ui.label(say(guessed_around_settings if form.touched else guessed, file=first)).classes(
            "hint"
        )
        if form.guess.all_columns > len(form.guess.columns.columns):
            many = (
                "The file has {number} columns: enter the name or number of each that is needed. "
                "The first are {names}."
            )
            names = frame.list_names(form.guess.columns.labels)
            frame.hint(say(many, number=form.guess.all_columns, names=names))
        kinds = {False: say("Records in time"), True: say("Table of a response")}
        kind = ui.toggle(kinds, value=form.description.table).props("no-caps")
        kind.on_value_change(lambda event: self._edited("table", event.value))
        for sections in _GROUPS:
            await self._group(sections, "basic", 3)
        self.more = ui.expansion(say("More that a calibration file can state")).classes("w-full")
        self.more.props("id=more-keys").on_value_change(self._open)
        with frame.actions():
            ui.button(say("Draw these columns"), on_click=self._plot).props("outline id=show")
        self.plot = ui.element("div").classes("chart")
        self.chart = None
        self.faults = ui.element("div").props("aria-live=polite id=faults")
        self.errors = frame.add_error_area()
        with frame.actions():
            ui.button(say("Confirm"), on_click=self._confirm).props("id=confirm")
            ui.button(say("Edit as text"), on_click=self._edit_as_text).props(
                "outline id=edit-text"
            )
        if form.guess.chart and not form.touched:
            self._draw(form.guess.chart)
            await self._examine()
        else:
            await self._plot()

    def _draw(self, drawn: bytes) -> None:
        if self.chart is not None:
            self.chart.show(drawn)
            return
        with self.plot:
            self.chart = frame.ChartView(drawn, CHART_HEIGHT_PX)
            first = self.user.session.files[0]
            caption = say("{file}, the beginning of the file as it is.", file=first)
            frame.hint(caption)

    async def _open(self) -> None:
        """Build what is asked for less often."""
        if not self.more.value or self.more.default_slot.children:
            return
        with self.more, contextlib.suppress(_Outdated):
            await self._group([section for each in _GROUPS for section in each], "more", 4)
            self._rows()
            known_responses = KnownResponses(self.user, self._edited, self.data.show)
            self.groups += [
                (container, [path]) for path, container in known_responses.elements.items()
            ]
            self._visible()

    async def _group(self, sections: Sequence[str], level: str, heading: int) -> None:
        """Ask for the keys of sections that are of a level."""
        mine = [path for path in KEYS if path.partition(".")[0] in sections]
        paths = [path for path in mine if KEYS[path].level == level]
        if not paths:
            return
        basic = say(SECTIONS[sections[0]].label)
        title = basic if level == "basic" else say("Channels and records")
        with ui.element("div").classes("w-full") as container, frame.add_group(title, heading):
            self.groups.append((container, paths))
            self._visible()
            for path in paths:
                if path == "sensor.model":
                    await self._model()
                else:
                    choices = self._choices(path) if path in ROLES else None
                    element = entry(KEYS[path], self.form.get(path), options=choices)
                    await self._placed(path, element, KEYS[path])
            if "records.excitation" in paths and len(self.user.session.files) > 1:
                value = self.form.description.optical_part
                hint = say("such as _ref")
                part_input = ui.input(say(_NAME_PART), value=value, placeholder=hint).props(PLAIN)
                part_input.on_value_change(
                    lambda event: self._edited("optical_part", event.value or "")
                )

    async def _placed(self, path: str, element: Any, key: Key) -> None:
        """Have an element set its key.

        Other users get a turn in between, because a form has many elements.
        """
        element.props(f"id={path.replace('.', '-')}")
        element.on_value_change(lambda event: self._edited(path, filled(key, event.value)))
        element.visible = self.form.description.applies(path)
        self.elements[path] = element
        turn = self.turn
        await asyncio.sleep(0)
        if turn != self.turn or self.body.is_deleted:
            raise _Outdated

    def _edited(self, path: str, value: Any) -> None:
        form = self.user.form
        if form is None or form.get(path) == value:
            return
        form.set(path, value)
        self.user.changed()
        self._visible()
        self.fit.refresh()

    def _visible(self) -> None:
        applies = self.form.description.applies
        for path, element in self.elements.items():
            element.visible = applies(path)
        for container, paths in self.groups:
            container.visible = any(map(applies, paths))

    def _choices(self, path: str) -> dict[Any, str] | None:
        """Return the columns to choose from; None if they are too many, and are written."""
        columns = self.form.guess.columns
        if self.form.guess.all_columns > len(columns.columns):
            return None
        optional = path not in NEEDED and KEYS[path].default is not ...
        listed = dict(zip(columns.columns, columns.labels, strict=True))
        return {None: say("none"), **listed} if optional else listed

    async def _model(self) -> None:
        """Ask for the model's core and its add-ons, which are one key."""
        core, *add_ons = (self.form.get("sensor.model") or "").split("+")
        cores = ui.select([*CORES], value=core, label=say("Model"))
        cores.props(f"{PLAIN} options-dense id=core")
        numbered = [name for name in add_ons if ":" in name]
        listed = [*ADD_ONS, *numbered]
        more = ui.select(listed, value=add_ons, label=say("Add-ons"), multiple=True)
        more.props(f"{PLAIN} options-dense use-chips id=add-ons")
        for element in (cores, more):
            element.on_value_change(
                lambda: self._edited("sensor.model", "+".join((cores.value, *more.value)))
            )

    def _rows(self) -> None:
        """Ask for entries of single files."""
        files = {file: file for file in self.user.session.files}
        keys = [key for key in ENTRIES["records"] if key.name != "reference_file"]
        values = self.form.get("different") or []
        with ui.element("div").classes("w-full") as container:
            frame.heading(say("Records that differ"), 4)
            rows = RowEntries(ENTRY_NAMES["records"], keys, values, options={"file": files})
            rows.on_change = lambda: self._edited("different", rows.value)
        self.groups.append((container, ["records"]))
        self._visible()

    async def _plot(self) -> None:
        form = self.user.form
        session = self.user.session
        if form is None:
            return
        self.errors.clear()
        container = self.plot
        errors = self.errors
        arguments = form.description, session.data, session.files, spoken().code
        drawn = await frame.run_sandboxed(self.user, errors, draw_chart, *arguments)
        if drawn is not None and container is self.plot and not container.is_deleted:
            self._draw(drawn)
            await self._examine()

    async def _examine(self) -> None:
        """Show what an identification would refuse in each file."""
        form = self.user.form
        session = self.user.session
        container = self.faults
        if form is None:
            return
        container.clear()
        arguments = form.description, session.data, session.files
        refused = await frame.run_sandboxed(self.user, container, find_faults, *arguments)
        if refused and not container.is_deleted:
            frame.show_faults(container, [InputError(**fields) for fields in refused], session)

    async def _confirm(self) -> None:
        self.errors.clear()
        form = self.user.form
        session = self.user.session
        if form is None:
            return
        try:
            calibration_text(form.description, session.files)
        except InputError as error:
            frame.show_error(self.errors, error, session)
            return
        await self.fit.show(ConfirmedCalibration(CALIBRATION, True))
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

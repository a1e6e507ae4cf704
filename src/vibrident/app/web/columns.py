"""Second step: the meaning of the columns, guessed and shown with a plot, for the user to confirm."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.data import DataStep
from vibrident.app.web.description import ROLES, Description, calibration_text, described
from vibrident.app.web.fit import FitStep
from vibrident.app.web.held import Confirmed, Form
from vibrident.app.web.looks import MOST_TEXT, Guess, calibration, chart, faults, guess, readable
from vibrident.app.web.preview import HEIGHT
from vibrident.app.web.session import CALIBRATION
from vibrident.app.web.users import User
from vibrident.app.web.written import edited
from vibrident.base.errors import InputError
from vibrident.data.records import EXCITATIONS
from vibrident.physics.models import ADD_ONS, CORES

QUANTITIES = {
    "acceleration": "acceleration, m/s²",
    "velocity": "velocity, m/s",
    "displacement": "displacement, m",
    "drive": "drive, its own unit",
}
REFERENCES = {
    "channel": "a column of the motion",
    "quadrature": "photodetectors, cos and sin",
    "heterodyne": "photodetector, on a carrier",
}
DIRECTIONS = {None: "not known", 1: "x grows with the phase", -1: "x falls with the phase"}


class _Outdated(Exception):
    """The files changed while the form was built, or the page was left."""


class ColumnsStep:
    """From files to a calibration file in the user's folder."""

    def __init__(self, user: User, data: DataStep, fit: FitStep) -> None:
        self.user, self.data, self.fit = user, data, fit
        self.turn = 0

    def build(self) -> None:
        """Build the section, hidden until there are data."""
        self.section = frame.step("Columns, units and model", "columns")
        with self.section:
            self.body = ui.element("div")
        self.section.visible = False

    async def show(self) -> None:
        """The files have changed: guess again, or use the uploaded calibration file."""
        self.fit.doubt()
        self.user.session.forget_calibration()
        if await self._look(again=True):
            frame.go(self.section)

    async def restore(self) -> None:
        """Show the user's earlier state."""
        await self._look(again=False)

    async def _look(self, *, again: bool) -> bool:
        """Update the form; returns whether there is something to confirm."""
        self.turn += 1
        turn, session = self.turn, self.user.session
        self.body.clear()
        self.section.visible = bool(session.names)
        if not session.names:
            self.user.form = None
            return False
        with self.body, ui.element("div").classes("actions"):
            ui.spinner(size="28px")
            ui.label("Looking at the files …").props("role=status")
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
            text = "" if name is None else await self.user.look(calibration, session.data, name)
            if name is None and (again or self.user.form is None):
                found = await self.user.look(guess, session.data, session.files)
                if turn == self.turn:
                    self.user.form = merged(self.user.form, found)
                    self.user.changed()
        except Exception as error:
            if turn == self.turn:
                frame.show_error(self.body, error, session)
            return False
        if turn != self.turn or self.body.is_deleted:  # the files changed meanwhile, or the page was left
            return False
        self.body.clear()
        with self.body:
            if name is not None:
                self._as_it_stands(name, text)
                await frame.looked(self.user, self.errors, readable, session.data, name)
                return True
            try:
                await self._ask()
            except _Outdated:
                return False
        return True

    def _as_it_stands(self, name: str, text: str) -> None:
        """Show the uploaded calibration file."""
        ui.label(f"{name} came with the data and describes the columns:").classes("hint")
        frame.Text("calibration-came", text)
        self.errors = ui.element("div").props("aria-live=assertive")
        with ui.element("div").classes("actions"):
            ui.button("Confirm", on_click=lambda: self.fit.show(Confirmed(name, False))).props("id=confirm")
            if len(text) <= MOST_TEXT:
                ui.button("Edit", on_click=lambda: self._write(name, text)).props("outline id=edit-text")

    def _edit_as_text(self) -> None:
        """The form as a calibration file, for what the form does not ask."""
        self.errors.clear()
        try:
            assert self.user.form is not None
            self._write(CALIBRATION, calibration_text(self.user.form.given, self.user.session.files))
        except Exception as error:
            frame.show_error(self.errors, error, self.user.session)

    def _write(self, name: str, text: str) -> None:
        """A calibration file to be edited, in place of what is shown."""
        self.turn += 1
        self.body.clear()
        with self.body:
            edited(self.user, name, text, self._taken, self.restore)

    async def _taken(self) -> None:
        self.data.show()
        await self.show()

    async def _ask(self) -> None:
        assert self.user.form is not None
        self.form = form = self.user.form
        self.fields: dict[str, list[Any]] = {}
        kept = "; your settings are kept" if form.touched else ""
        first = self.user.session.files[0]
        ui.label(f"Guessed from the names in {first} and the motion{kept}. Please check.").classes("hint")
        if form.guess.all_columns > len(form.guess.columns.columns):
            ui.label(
                f"The file has {form.guess.all_columns} columns: enter the name or number of each that is needed. "
                f"The first are {frame.listed(form.guess.columns.labels)}."
            ).classes("hint")
        kind = ui.toggle({False: "Records in time", True: "Table of a response"}, value=form.given.table)
        kind.props("no-caps").on_value_change(lambda event: self._edited("table", event.value))
        self.of_records, self.of_table = ui.element("div"), ui.element("div")
        with self.of_records:
            self.of_motion, self.of_channel, self.of_light = (ui.element("div") for _ in range(3))
        self._visible()
        with self.of_records:
            await self._records()
        with self.of_table:
            await self._table()
        await self._model()
        self._visible()
        with ui.element("div").classes("actions"):
            ui.button("Draw these columns", on_click=self._plot).props("outline id=show")
        self.plot, self.chart = ui.element("div").classes("chart"), None
        self.faults = ui.element("div").props("aria-live=polite id=faults")
        self.errors = ui.element("div").props("aria-live=assertive")
        with ui.element("div").classes("actions"):
            ui.button("Confirm", on_click=self._confirm).props("id=confirm")
            ui.button("Edit as text", on_click=self._edit_as_text).props("outline id=edit-text")
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
            self.chart = frame.Chart(drawn, HEIGHT)
            ui.label(f"{self.user.session.files[0]}, the beginning of the file as it is.").classes("hint")

    async def _field(self, name: str, element: Any, identity: str = "", more: str = "") -> Any:
        """An element that shows and sets one field of the form."""
        self.fields.setdefault(name, []).append(element)
        element.on_value_change(lambda event: self._edited(name, event.value))
        return await self._placed(element, identity, more)

    async def _placed(self, element: Any, identity: str, more: str = "") -> Any:
        """An element in the style of the form. Other users have a turn: a form has many elements."""
        element.props(f"dense outlined stack-label {more}" + (f" id={identity}" if identity else ""))
        turn = self.turn
        await asyncio.sleep(0)
        if turn != self.turn or self.body.is_deleted:
            raise _Outdated
        return element

    def _edited(self, name: str, value: Any) -> None:
        form = self.user.form
        if form is None or form.get(name) == value:
            return
        form.set(name, value)
        self.user.changed()
        for element in self.fields.get(name, []):  # some occur twice, for records and for a table
            if element.value != value:
                element.value = value
        self._visible()
        self.fit.refresh()

    def _visible(self) -> None:
        given = self.user.form.given if self.user.form else Description()
        self.of_records.visible, self.of_table.visible = not given.table, given.table
        light = given.reference_by != "channel"
        self.of_channel.visible, self.of_light.visible = not light, light
        shown = {"rate_hz": given.time is None, "second_signal": given.reference_by == "quadrature",
                 "carrier_hz": given.reference_by == "heterodyne"}  # fmt: skip
        for name, visible in shown.items():
            for element in self.fields.get(name, []):
                element.visible = visible

    async def _records(self) -> None:
        with self.of_motion, frame.group("Reference: motion of the sensor"):
            await self._select(REFERENCES, "Reference: taken from", "reference_by", "reference-by")
            await self._number("Reference: relative u (optional)", "standard_uncertainty")
        with self.of_channel, ui.element("div").classes("fields"):
            await self._column("Reference: column", "reference", "reference-column")
            await self._select(QUANTITIES, "Reference: quantity", "quantity", "quantity")
            await self._number("Reference: SI units per unit of the file", "scale", "scale")
            await self._text("Reference: unit, for reports", "unit")
        with self.of_light, ui.element("div").classes("fields"):
            await self._interferometer()
        with frame.group("Response: output of the sensor"):
            await self._column("Response: column", "response", "response-column")
            await self._text("Response: unit", "response_unit", "response-unit")
            await self._number("Response: units per unit of the file", "response_scale", "response-scale")
        with frame.group("Sampling and excitation"):
            await self._column("Time column, in s", "time", "time-column", optional=True)
            await self._number("Sampling rate in Hz (or the file's)", "rate_hz", "rate")
            await self._select(EXCITATIONS, "Excitation", "excitation", "excitation")

    async def _interferometer(self) -> None:
        await self._column("First signal: cos, or carrier", "first_signal", "first-signal")
        await self._column("Second signal: sin", "second_signal", "second-signal")
        await self._number("Wavelength in the medium, in nm", "wavelength_nm", "wavelength")
        await self._number("Passes to the target and back", "passes", "passes")
        await self._number("Carrier in Hz, approximately", "carrier_hz", "carrier")
        await self._select(DIRECTIONS, "Direction of x", "direction", "direction")
        await self._number("Wavelength: relative u (optional)", "wavelength_relative_uncertainty")
        await self._number("Optical channel later by, in s (optional)", "optical_delay_s")
        await self._number("u of this delay, in s (optional)", "optical_delay_standard_uncertainty_s")
        await self._number("Optical sampling rate in Hz, if another", "optical_rate_hz")
        await self._text("Signals in files of their own: more in their names", "optical_part", "optical-part")

    async def _table(self) -> None:
        with frame.group("Columns of the table"):
            await self._column("Frequency, in Hz", "frequency")
            await self._column("Magnitude", "magnitude")
            await self._column("Phase", "phase", optional=True)
            await self._select(("deg", "rad"), "Unit of the phase", "phase_unit")
            await self._column("Standard uncertainty of the magnitude", "magnitude_uncertainty", optional=True)
            await self._column("Standard uncertainty of the phase", "phase_uncertainty", optional=True)
            await self._select(QUANTITIES, "Reference: quantity", "quantity")
            await self._text("Response: unit", "response_unit")
            await self._number("Response: unit per unit in the file", "response_scale")

    async def _model(self) -> None:
        with frame.group("Sensor and model"):
            for key in self.form.given.sensor:
                await self._text(key.replace("_", " ").capitalize(), f"sensor.{key}")
            await self._select(tuple(CORES), "Model", "core", "core")
            (await self._select(tuple(ADD_ONS), "Add-ons", "add_ons", "add-ons")).props("multiple use-chips")

    async def _column(self, label: str, name: str, identity: str = "", *, optional: bool = False) -> None:
        """A column chosen from a list, or written by its name or number if the list would be too long."""
        columns, chosen = self.form.guess.columns, self.form.get(name)
        if self.form.guess.all_columns > len(columns.columns):
            shown = "" if chosen is None else str(chosen)
            element = ui.input(label, value=shown, placeholder="name, or number from 1")
            element.on_value_change(lambda event: self._edited(name, _column_named(event.value or "")))
            await self._placed(element, identity)
            return
        choices: dict[Any, str] = {None: "none"} if optional else {}
        choices |= dict(zip(columns.columns, columns.labels, strict=True))
        if chosen is not None:
            choices.setdefault(chosen, f"{chosen} (not in this file)")
        await self._select(choices, label, name, identity)

    async def _select(self, choices: Any, label: str, name: str, identity: str = "") -> Any:
        options = choices if isinstance(choices, dict) else list(choices)
        element = ui.select(options, value=self.form.get(name), label=label, multiple=name == "add_ons")
        return await self._field(name, element, identity, "options-dense")

    async def _number(self, label: str, name: str, identity: str = "") -> None:
        element = ui.number(label, value=self.form.get(name), format="%.12g")
        await self._field(name, element, identity, "step=any")

    async def _text(self, label: str, name: str, identity: str = "") -> None:
        await self._field(name, ui.input(label, value=self.form.get(name)), identity)

    async def _plot(self) -> None:
        form, session = self.user.form, self.user.session
        if form is None:
            return
        self.errors.clear()
        place, errors = self.plot, self.errors
        drawn = await frame.looked(self.user, errors, chart, form.given, session.data, session.files)
        if drawn is not None and place is self.plot and not place.is_deleted:
            self._draw(drawn)
            await self._examine()

    async def _examine(self) -> None:
        """Say of every file what an identification would refuse."""
        form, session, place = self.user.form, self.user.session, self.faults
        if form is None:
            return
        place.clear()
        found = await frame.looked(self.user, place, faults, form.given, session.data, session.files)
        if found and not place.is_deleted:
            frame.show_faults(place, [InputError(**fields) for fields in found], session)

    async def _confirm(self) -> None:
        self.errors.clear()
        form, session = self.user.form, self.user.session
        if form is None:
            return
        try:
            calibration_text(form.given, session.files)
        except InputError as error:
            frame.show_error(self.errors, error, session)
            return
        await self.fit.show(Confirmed(CALIBRATION, True))


def _column_named(text: str) -> int | str | None:
    text = text.strip()
    return int(text) if text.isdecimal() and len(text) < 9 else text or None


def merged(before: Form | None, found: Guess) -> Form:
    """The form for a new guess: keeps what the user set, except columns that no longer exist."""
    given = replace(described(found.columns, found.excitation or "sine"), optical_part=found.optical_part)
    if before is None or not before.touched:
        return Form(found, given)
    for role in ROLES:
        if role not in before.touched and getattr(before.given, role) not in (None, *found.columns.columns):
            setattr(before.given, role, getattr(given, role))
    return Form(found, before.given, before.touched)

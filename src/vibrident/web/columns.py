"""Second step: what the columns mean, guessed and shown with a plot, for the user to confirm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import run, ui

from vibrident.errors import InputError, VibridentError
from vibrident.io.guess import Columns, guess_columns
from vibrident.memory import give_back
from vibrident.web import frame
from vibrident.web.description import Description, calibration_text, described
from vibrident.web.motion import likely_excitation
from vibrident.web.preview import preview
from vibrident.web.session import CALIBRATION, refuse_outside

QUANTITIES = {
    "acceleration": "acceleration, m/s²",
    "velocity": "velocity, m/s",
    "displacement": "displacement, m",
    "drive": "drive, its own unit",
}
EXCITATIONS = ("sine", "multisine", "sweep", "random", "shock", "decay")
CORES = ("accelerometer", "velocity-pickup")
ADD_ONS = ("delay", "highpass", "mode2", "cubic", "boxcar")


class ColumnsStep:
    """From files to a calibration file in the user's folder."""

    def __init__(self, user: frame.User) -> None:
        self.user = user
        self.given = Description()
        self.chart: Any = None

    def build(self, on_confirmed: Callable[..., Any], on_doubt: Callable[[], Any]) -> None:
        """Build the section, hidden until there are data."""
        self.on_confirmed, self.on_doubt = on_confirmed, on_doubt
        self.section = frame.step(2, "Columns, units and model", "columns")
        with self.section:
            self.body = ui.element("div")
        self.section.visible = False

    async def show(self) -> None:
        """Guess from the first file, or take the calibration file that came with the data."""
        session = self.user.session
        self.on_doubt()
        self.body.clear()
        self.section.visible = bool(session.files)
        if not session.files:
            return
        session.forget_calibration()
        try:
            if (name := session.calibration) is not None:
                self._as_it_stands(name)
                return
            guess = await run.io_bound(guess_columns, session.data / session.files[0])
            assert guess is not None
            excitation = await run.io_bound(likely_excitation, guess, session.data, session.files)
        except VibridentError as error:
            frame.show_error(self.body, error, session)
            return
        give_back()
        self.given = described(guess, excitation or "sine")
        with self.body:
            self._form(guess)
        await self._plot()

    def _as_it_stands(self, name: str) -> None:
        """Show the calibration file that came with the data; ``show`` shows what is wrong with it."""
        path = self.user.session.data / name
        refuse_outside(path)
        text = path.read_text(encoding="utf-8-sig")
        with self.body:
            ui.label(f"{name} came with the data and says what the columns mean:").classes("hint")
            ui.code(text, language="toml").classes("w-full")
            ui.button("Confirm", on_click=lambda: self.on_confirmed(name, None)).props("id=confirm")

    def _form(self, guess: Columns) -> None:
        given = self.given
        ui.label(f"Guessed from the names in {self.user.session.files[0]} and the motion; please check.").classes(
            "hint"
        )
        ui.toggle({False: "Records in time", True: "Table of a response"}).bind_value(given, "table").props("no-caps")
        choices = dict(zip(guess.columns, guess.labels, strict=True))
        with ui.element("div").bind_visibility_from(given, "table", value=False):
            self._records(choices)
        with ui.element("div").bind_visibility_from(given, "table"):
            self._table(choices)
        self._model()
        with ui.element("div").classes("actions"):
            ui.button("Draw these columns", on_click=self._plot).props("outline id=show")
        self.plot, self.chart = ui.element("div").classes("chart"), None
        self.errors = ui.element("div").props("aria-live=assertive")
        with ui.element("div").classes("actions"):
            ui.button("Confirm", on_click=self._confirm).props("id=confirm")

    def _records(self, choices: dict[int | str, str]) -> None:
        given = self.given
        with _group("Reference: what moved the sensor"):
            _select(choices, "Reference: column", given, "reference", "reference-column")
            _select(QUANTITIES, "Reference: quantity", given, "quantity", "quantity")
            _number("Reference: SI units per unit of the file", given, "scale", "scale")
            _text("Reference: unit, for reports", given, "unit")
            _number("Reference: relative u (optional)", given, "standard_uncertainty")
        with _group("Response: what the sensor gave"):
            _select(choices, "Response: column", given, "response", "response-column")
            _text("Response: unit", given, "response_unit", "response-unit")
            _number("Response: such units per unit of the file", given, "response_scale", "response-scale")
        with _group("Sampling and excitation"):
            _select({None: "none"} | choices, "Time column, in s", given, "time", "time-column")
            _number("Sampling rate in Hz (or the file's)", given, "rate_hz", "rate").bind_visibility_from(
                given, "time", backward=lambda time: time is None
            )
            _select(EXCITATIONS, "Excitation", given, "excitation", "excitation")

    def _table(self, choices: dict[int | str, str]) -> None:
        given, optional = self.given, {None: "none"} | choices
        with _group("Columns of the table"):
            _select(choices, "Frequency, in Hz", given, "frequency")
            _select(choices, "Magnitude", given, "magnitude")
            _select(optional, "Phase", given, "phase")
            _select(("deg", "rad"), "Unit of the phase", given, "phase_unit")
            _select(optional, "Standard uncertainty of the magnitude", given, "magnitude_uncertainty")
            _select(optional, "Standard uncertainty of the phase", given, "phase_uncertainty")
            _select(QUANTITIES, "Reference: quantity", given, "quantity")
            _text("Response: unit", given, "response_unit")
            _number("Response: unit per unit in the file", given, "response_scale")

    def _model(self) -> None:
        given = self.given
        with _group("Sensor and model"):
            for key in given.sensor:
                ui.input(key.replace("_", " ").capitalize()).bind_value(given.sensor, key).props(
                    "dense outlined stack-label"
                )
            _select(CORES, "Model", given, "core", "core")
            _select(ADD_ONS, "Add-ons", given, "add_ons", "add-ons").props("multiple use-chips")

    async def _plot(self) -> None:
        self.errors.clear()
        try:
            figure = await run.io_bound(preview, self.given, self.user.session.data, self.user.session.files)
        except VibridentError as error:
            frame.show_error(self.errors, error, self.user.session)
            return
        finally:
            give_back()
        if figure is None:  # the server is being stopped
            return
        if self.chart is not None:  # a new one in its place would be drawn before the old one is gone
            self.chart.update_figure(figure)
            return
        with self.plot:
            self.chart = ui.plotly(figure).classes("chart")
            ui.label(f"{self.user.session.files[0]}, its beginning as it stands in the file.").classes("hint")

    async def _confirm(self) -> None:
        self.errors.clear()
        session = self.user.session
        try:
            text = calibration_text(self.given, session.files)
        except InputError as error:
            frame.show_error(self.errors, error, session)
            return
        session.write_calibration(text)
        await self.on_confirmed(CALIBRATION, self.given)


def _group(title: str) -> ui.element:
    """Fields that belong together, below their heading."""
    ui.html(f"<h3>{title}</h3>", sanitize=False)
    return ui.element("div").classes("fields").props(f'role=group aria-label="{title}"')


def _select(choices: Any, label: str, given: Any, name: str, identity: str = "") -> Any:
    options = choices if isinstance(choices, dict) else list(choices)
    element = ui.select(options, label=label, multiple=name == "add_ons").bind_value(given, name)
    return element.props(f"dense outlined stack-label options-dense {f'id={identity}' if identity else ''}")


def _number(label: str, given: Any, name: str, identity: str = "") -> Any:
    element = ui.number(label, format="%.12g").bind_value(given, name)
    return element.props(f"dense outlined stack-label step=any {f'id={identity}' if identity else ''}")


def _text(label: str, given: Any, name: str, identity: str = "") -> Any:
    element = ui.input(label).bind_value(given, name)
    return element.props(f"dense outlined stack-label {f'id={identity}' if identity else ''}")

"""Build the third step: the estimator, and the identification with its progress and cost curve."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.form.description import calibration_text
from vibrident.app.web.language import phrase, translate
from vibrident.app.web.run_step import RunStep
from vibrident.app.web.sandboxed import read_calibration_text
from vibrident.app.web.state import ConfirmedCalibration
from vibrident.app.web.tasks import TaskRequest, identify_request
from vibrident.app.web.user import User
from vibrident.app.web.words import LABELS
from vibrident.app.workflow.estimators import AUTO, DISCRETISATIONS, UNCERTAINTIES, estimators_with
from vibrident.fit.registry import ESTIMATORS

#: What the uncertainties cover, in words.
_COVERS = {
    "auto": phrase("auto: the noise, and a misfit where there is one"),
    "noise": phrase("noise: the noise alone"),
    "inflated": phrase("inflated: the misfit always"),
}


class FitStep(RunStep):
    """The section from the confirmed calibration file to a result."""

    ids = ""

    def __init__(self, user: User) -> None:
        super().__init__(user, user.fit)

    def build(self, on_result: Callable[..., Awaitable[Any]]) -> None:
        """Build the section, hidden until the columns are confirmed."""
        self.section = frame.add_step(translate("Identify"), "identify")
        with self.section:
            with ui.expansion(translate("The calibration file: as confirmed above")).classes(
                "w-full"
            ):
                self.text = frame.Text("calibration-text", translate("Calibration file"))
            stepping = estimators_with("discretisation")
            with ui.element("div").classes("fields wide"):
                titles = {
                    name: f"{name}: {translate(estimator.title)}"
                    for name, estimator in ESTIMATORS.all().items()
                }
                self.estimator = ui.select(
                    {AUTO: translate("{name}: chosen by the data", name=AUTO), **titles},
                    value=AUTO,
                    label=translate(LABELS["identify.estimator"]),
                )
                self.discretisation = ui.select(
                    list(DISCRETISATIONS),
                    value="bandlimited",
                    label=f"{translate(LABELS['identify.discretisation'])} ({', '.join(stepping)})",
                )
                covers = {name: translate(_COVERS[name]) for name in UNCERTAINTIES}
                self.uncertainty = ui.select(
                    covers, value="auto", label=translate(LABELS["identify.uncertainty"])
                )
                for element in (self.estimator, self.discretisation, self.uncertainty):
                    element.props("dense outlined stack-label options-dense")
            self.discretisation.visible = False
            self.estimator.on_value_change(
                lambda event: self.discretisation.set_visibility(event.value in stepping)
            )
            self.build_controls(
                translate("Identify"), translate("share of the iterations"), on_result
            )
        self.update()

    def withdraw_confirmation(self) -> None:
        """Withdraw the confirmation; a running identification goes on with its copy of the data."""
        self.user.confirmed = None
        self.user.changed()
        self.update()

    async def show(self, confirmed: ConfirmedCalibration) -> None:
        """Offer to identify with this calibration file."""
        self.user.confirmed = confirmed
        self.user.changed()
        self.errors.clear()
        await self._read()
        frame.scroll_to(self.section)

    async def restore(self) -> None:
        """Show the confirmed file and the running identification again."""
        if self.user.confirmed:
            await self._read()
        self.timer.activate()
        self.update()

    def refresh(self) -> None:
        """Take over the form's values."""
        if not (self.user.confirmed and self.user.confirmed.from_form and self.user.form):
            return
        self.start.disable()
        with frame.reporting(self.errors, self.user):
            self.text.show(calibration_text(self.user.form.description, self.user.session.files))
            self.update()

    async def _read(self) -> None:
        confirmed = self.user.confirmed
        session = self.user.session
        assert confirmed is not None
        if confirmed.from_form:
            self.refresh()
            return
        self.user.confirmed = None
        with frame.reporting(self.errors, self.user):
            name = confirmed.name
            text = await self.user.run_sandboxed(read_calibration_text, session.data, name)
            self.text.show(text)
            self.user.confirmed = confirmed
        self.update()

    def update(self) -> None:
        """Update buttons and visible parts."""
        super().update()
        is_confirmed = self.user.confirmed is not None
        # one under way, or broken off, which can be repeated
        self.section.visible = is_confirmed or self.run.state is not None
        self.start.set_enabled(is_confirmed and not self.run.busy)

    def make_request(self) -> TaskRequest:
        """Return the identification that is chosen."""
        assert self.user.confirmed is not None
        return identify_request(
            self.user.confirmed.name,
            self.estimator.value,
            self.discretisation.value,
            self.uncertainty.value,
        )

    def subject(self, request: TaskRequest) -> str:
        """Return the identification as a command."""
        return request.command

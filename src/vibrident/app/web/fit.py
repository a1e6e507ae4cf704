"""Build the third step: the estimator, and the identification with its progress and cost curve."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

import numpy as np
from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.form.description import calibration_text
from vibrident.app.web.language import page_language, phrase, translate
from vibrident.app.web.sandboxed import read_calibration_text
from vibrident.app.web.state import Choices, ConfirmedCalibration, Job
from vibrident.app.web.translated import charts
from vibrident.app.web.user import User
from vibrident.app.web.words import LABELS
from vibrident.app.web.worker import StoppedError
from vibrident.app.workflow.estimators import AUTO, DISCRETISATIONS, UNCERTAINTIES, estimators_with
from vibrident.fit.registry import ESTIMATORS
from vibrident.show import axes
from vibrident.show.views import BLUE, ORANGE, Figure, Look, Panel, Series, Stack

_PACE_S = 0.25  # seconds between two updates from the identification
CURVE_HEIGHT_PX = 230  # height of the curve in pixels
#: What the uncertainties cover, in words.
_COVERS = {
    "auto": phrase("auto: the noise, and a misfit where there is one"),
    "noise": phrase("noise: the noise alone"),
    "inflated": phrase("inflated: the misfit always"),
}
_MAX_DRAWN_ITERATIONS = 2000  # most iterations drawn, of all starts together


class FitStep:
    """The section from the confirmed calibration file to a result."""

    def __init__(self, user: User) -> None:
        self.user = user
        self.over: Job | None = user.job if user.job and user.job.over else None

    def build(self, on_result: Callable[[], Awaitable[Any]]) -> None:
        """Build the section, hidden until the columns are confirmed."""
        self.on_result = on_result
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
            with frame.actions():
                self.start = ui.button(translate("Identify"), on_click=self._identify).props(
                    "id=start"
                )
                self.stop = ui.button(translate("Cancel"), on_click=self.user.worker.cancel).props(
                    "outline color=negative"
                )
                self.spinner = ui.spinner(size="28px")
                self.status = ui.label("").props("role=status id=status")
            self.share = ui.linear_progress(0.0, show_value=False, size="8px")
            self.share.props("id=share").props["aria-label"] = translate("share of the iterations")
            self.errors = frame.add_error_area()
            self.curve = frame.GrowingChart(ui.element("div").classes("chart"), CURVE_HEIGHT_PX)
        self.timer = ui.timer(_PACE_S, self._follow, active=False)
        self.stop.visible = self.spinner.visible = self.section.visible = self.share.visible = False

    def withdraw_confirmation(self) -> None:
        """Withdraw the confirmation; a running identification goes on with its copy of the data."""
        self.user.confirmed = None
        self.user.changed()
        self._renew()

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
        if self.user.busy:
            self.timer.activate()
        self._renew()
        if self.over is not None:
            self._tell(self.over)

    def refresh(self) -> None:
        """Take over the form's values."""
        if not (self.user.confirmed and self.user.confirmed.from_form and self.user.form):
            return
        self.errors.clear()
        try:
            self.text.show(calibration_text(self.user.form.description, self.user.session.files))
        except Exception as error:
            frame.show_error(self.errors, error, self.user.session)
            self.start.disable()
            return
        self._renew()

    async def _read(self) -> None:
        confirmed = self.user.confirmed
        session = self.user.session
        assert confirmed is not None
        if confirmed.from_form:
            self.refresh()
            return
        text = await frame.run_sandboxed(
            self.user, self.errors, read_calibration_text, session.data, confirmed.name
        )
        if text is None:
            self.user.confirmed = None
        else:
            self.text.show(text)
        self._renew()

    def _renew(self) -> None:
        """Update enabled buttons and visible parts."""
        busy = self.user.busy
        confirmed = self.user.confirmed is not None
        broken_off = self.user.running is not None  # which can be repeated
        self.section.visible = confirmed or busy or broken_off
        self.start.set_enabled(confirmed and not busy)
        self.stop.visible = self.spinner.visible = busy

    async def _repeat(self, choices: Choices) -> None:
        """Identify again with the earlier choices, whatever the form has been set to since."""
        self.estimator.value = choices.estimator
        self.discretisation.value = choices.discretisation
        self.uncertainty.value = choices.uncertainty
        self._begin(lambda: self.user.start(choices, again=True))

    async def _identify(self) -> None:
        user = self.user
        confirmed = self.user.confirmed
        if confirmed is None:
            return
        settings = (self.estimator.value, self.discretisation.value, self.uncertainty.value)

        def begin() -> None:
            user.write_form()
            user.start(Choices(confirmed.name, *settings))

        self._begin(begin)

    def _begin(self, begin: Callable[[], None]) -> None:
        if self.user.busy:
            return
        self.errors.clear()
        self.curve.forget()
        try:
            begin()
        except Exception as error:
            frame.show_error(self.errors, error, self.user.session)
            return
        self._renew()
        self.timer.activate()
        self.section.client.run_javascript("vibrident.see('status')")

    async def _follow(self) -> None:
        """Update from the identification."""
        job = self.user.job
        if job is None or job is self.over:
            self.timer.deactivate()
            return
        self.status.text = job.status(page_language())
        self.share.visible = job.share is not None and not job.over
        self.share.value = job.share or 0.0
        if self.curve.grows_to(sum(map(len, job.starts))):
            self.curve.show(_curve(job.starts))
        if not job.over:
            return
        self.over = job
        self.timer.deactivate()
        self._renew()
        self._tell(job)
        if job.error is None and job.words == Job.DONE:
            self.curve.forget()  # the result shows the whole curve
            await self.on_result()

    def _tell(self, job: Job) -> None:
        """Say why an identification failed."""
        if job.error is None:
            return
        frame.show_error(self.errors, job.error, self.user.session)
        if isinstance(job.error, StoppedError) and job.choices and not self.errors.is_deleted:
            with self.errors:
                broken_off = translate("Broken off: {what}", what=job.choices.command)
                frame.hint(broken_off).props("id=broken-off")
                ask = partial(self._repeat, job.choices)
                ui.button(translate("Repeat"), on_click=ask).props("outline id=repeat")


def _curve(starts: list[list[float]]) -> dict[str, Any]:
    """Return the chart of the cost over the iterations, a line for each start."""
    remaining = _MAX_DRAWN_ITERATIONS
    series = []
    for number, costs in reversed(list(enumerate(starts, 1))):
        points = [(i, cost) for i, cost in enumerate(costs, 1) if np.isfinite(cost) and cost > 0][
            -max(remaining, 1) :
        ]
        remaining -= len(points)
        x, y = np.array(points, dtype=float).reshape(-1, 2).T
        look = Look(BLUE if number == len(starts) else ORANGE, marker="o")
        series.append(
            Series(
                x, y, phrase("start {number}", number=number) if 1 < len(starts) <= 8 else "", look
            )
        )
        if remaining <= 0:
            break
    x_axis = axes.linear(
        phrase("Iteration"),
        np.concatenate([[0.0, 2.0], *(line.x for line in series)]),
        whole_numbers=True,
        most=8,
    )
    y_axis = axes.size(phrase("Cost"), np.concatenate([line.y for line in series]))
    ((_, chart),) = charts(
        page_language(),
        Figure("cost", "", (Stack((Panel(x_axis, y_axis, tuple(series[::-1]), 1.1),)),)),
    )
    return chart

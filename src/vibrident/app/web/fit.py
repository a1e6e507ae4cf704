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
from vibrident.app.web.run_step import RunStep
from vibrident.app.web.sandboxed import read_calibration_text
from vibrident.app.web.state import Choices, ConfirmedCalibration, Job
from vibrident.app.web.translated import charts
from vibrident.app.web.user import User
from vibrident.app.web.words import LABELS
from vibrident.app.workflow.estimators import AUTO, DISCRETISATIONS, UNCERTAINTIES, estimators_with
from vibrident.fit.registry import ESTIMATORS
from vibrident.show import axes
from vibrident.show.views import BLUE, ORANGE, Figure, Look, Panel, Series, Stack

#: What the uncertainties cover, in words.
_COVERS = {
    "auto": phrase("auto: the noise, and a misfit where there is one"),
    "noise": phrase("noise: the noise alone"),
    "inflated": phrase("inflated: the misfit always"),
}
_MAX_DRAWN_ITERATIONS = 2000  # of all starts together


class FitStep(RunStep):
    """The section from the confirmed calibration file to a result."""

    ids = ""

    def __init__(self, user: User) -> None:
        super().__init__(user)
        self.reported = user.job if user.job and user.job.over else None

    @property
    def run(self) -> Job | None:
        """Return the latest identification."""
        return self.user.job

    @property
    def is_busy(self) -> bool:
        """Return whether an identification is under way."""
        return self.user.busy

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
            self.build_controls(
                translate("Identify"),
                self._identify,
                self.user.worker.cancel,
                translate("share of the iterations"),
            )
        self.stop.visible = self.spinner.visible = self.section.visible = False

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
        if self.user.busy:
            self.timer.activate()
        self.update()
        if isinstance(self.reported, Job):
            self._report_failure(self.reported)

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
        self.update()

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
        self.update()

    def update(self) -> None:
        """Update buttons and visible parts."""
        super().update()
        is_confirmed = self.user.confirmed is not None
        is_broken_off = self.user.running is not None  # which can be repeated
        self.section.visible = is_confirmed or self.is_busy or is_broken_off
        self.start.set_enabled(is_confirmed and not self.is_busy)

    async def _repeat(self, choices: Choices) -> None:
        """Identify again with the earlier choices, whatever the form has been set to since."""
        self.estimator.value = choices.estimator
        self.discretisation.value = choices.discretisation
        self.uncertainty.value = choices.uncertainty
        self.begin(lambda: self.user.start(choices, again=True))

    async def _identify(self) -> None:
        user = self.user
        confirmed = self.user.confirmed
        if confirmed is None:
            return
        settings = (self.estimator.value, self.discretisation.value, self.uncertainty.value)

        def start() -> None:
            user.write_form()
            user.start(Choices(confirmed.name, *settings))

        self.begin(start)

    def begin(self, start: Callable[[], None]) -> None:
        """Begin an identification, and scroll to its status."""
        super().begin(start)
        if self.is_busy:
            self.section.client.run_javascript("vibrident.see('status')")

    def draw(self, run: Job) -> None:
        """Draw the cost over the iterations."""
        if self.chart.grows_to(sum(map(len, run.starts))):
            self.chart.show(_curve(run.starts))

    async def finish(self, run: Job) -> None:
        """Show the result, or why the identification failed."""
        self._report_failure(run)
        if run.error is None and run.words == Job.DONE:
            self.chart.forget()  # the result shows the whole curve
            await self.on_result()

    def _report_failure(self, job: Job) -> None:
        if job.error is not None:
            subject = job.choices.command if job.choices else ""
            repeat = partial(self._repeat, job.choices) if job.choices else None
            self.report_failure(job.error, subject, repeat)


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

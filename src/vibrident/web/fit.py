"""Third step: the estimator, and the identification with its progress and training curve."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from nicegui import ui

from vibrident.cli.options import DISCRETISATIONS, UNCERTAINTIES
from vibrident.errors import VibridentError
from vibrident.plots.style import BLUE
from vibrident.report.figures import axis, figure, log_marks, whole_numbers
from vibrident.result import Result
from vibrident.web import frame
from vibrident.web.choices import Choices
from vibrident.web.session import RESULT, refuse_outside

ESTIMATORS = {
    "auto": "auto: chosen by the data",
    "ipnn": "ipnn: the physics-informed network",
    "ml": "ml: maximum likelihood",
    "lsm": "lsm: least squares on the response",
}
#: Seconds between two looks at the training curve.
_PACE_S = 0.25


class FitStep:
    """From the confirmed calibration file to a result."""

    def __init__(self, user: frame.User) -> None:
        self.user = user
        self.calibration = ""
        self.curve: Any = None

    def build(self, on_result: Callable[[], Any]) -> None:
        """Build the section, hidden until the columns are confirmed."""
        self.on_result = on_result
        self.section = frame.step(3, "Identify", "identify")
        with self.section:
            with ui.expansion("The calibration file: what is confirmed above").classes("w-full"):
                self.text = ui.code("", language="toml").classes("w-full")
            with ui.element("div").classes("fields wide"):
                self.estimator = ui.select(ESTIMATORS, value="auto", label="Estimator")
                self.discretisation = ui.select(
                    list(DISCRETISATIONS), value="bandlimited", label="Discretisation (ipnn)"
                ).bind_visibility_from(self.estimator, "value", backward=lambda value: value == "ipnn")
                self.uncertainty = ui.select(list(UNCERTAINTIES), value="auto", label="Uncertainties cover")
                for element in (self.estimator, self.discretisation, self.uncertainty):
                    element.props("dense outlined stack-label options-dense")
            with ui.element("div").classes("actions"):
                self.start = ui.button("Identify", on_click=self._identify).props("id=start")
                self.stop = ui.button("Cancel", on_click=self.user.worker.cancel).props("outline color=negative")
                self.spinner = ui.spinner(size="28px")
                self.status = ui.label("").props("role=status id=status")
            self.errors = ui.element("div").props("aria-live=assertive")
            self.place = ui.element("div").classes("chart")
        self.stop.visible = self.spinner.visible = self.section.visible = False

    def hide(self) -> None:
        """What was confirmed no longer holds."""
        self.user.worker.cancel()
        self.section.visible = False

    async def show(self, calibration: str, given: Any) -> None:
        """Offer to identify with this calibration file."""
        path = self.user.session.data / calibration
        self.errors.clear()
        self.section.visible = True
        self.calibration = calibration
        try:
            refuse_outside(path)
        except VibridentError as error:
            self.start.disable()
            frame.show_error(self.errors, error, self.user.session)
            return
        self.start.enable()
        self.text.content = path.read_text(encoding="utf-8-sig")

    async def _identify(self) -> None:
        if self.user.worker.busy:
            return
        session = self.user.session
        choices = Choices(
            self.calibration, self.estimator.value, self.discretisation.value, uncertainty=self.uncertainty.value
        )
        place = session.folder / RESULT
        text = (session.data / self.calibration).read_text(encoding="utf-8-sig")
        self._working(True)
        try:
            await self._follow({**choices.task, "result": str(place)})
            content = place.read_bytes()
            name = f"{len(self.user.results) + 1}"
            result = Result.load(place)
            label = f"{name}: {result.model}, {result.estimator}"
            self.user.results.append(frame.Named(label, result, content, text, choices))
            self.status.text = "Identified."
            if result.training is not None:  # the result draws the whole of it
                self._forget_curve()
            self.on_result()
        except VibridentError as error:
            self.status.text = ""
            frame.show_error(self.errors, error, session)
        except asyncio.CancelledError:
            self.status.text = "Cancelled."
        finally:
            place.unlink(missing_ok=True)
            self._working(False)

    async def _follow(self, task: dict[str, Any]) -> None:
        costs: list[float] = []
        shown = 0.0
        async for iteration, most, cost in self.user.worker.run(task, self.user.session.data):
            costs.append(cost)
            if time.monotonic() > shown + _PACE_S:
                shown = time.monotonic()
                self.status.text = f"Iteration {iteration} of at most {most}, cost {cost:.4g}"
                self._draw(costs)
        if costs:
            self._draw(costs)

    def _draw(self, costs: list[float]) -> None:
        if self.curve is None:  # plotly draws nothing where it cannot be seen
            with self.place:
                self.curve = ui.plotly(_curve(costs)).classes("chart")
        self.curve.update_figure(_curve(costs))

    def _forget_curve(self) -> None:
        self.place.clear()
        self.curve = None

    def _working(self, now: bool) -> None:
        self.start.set_enabled(not now)
        self.stop.visible = self.spinner.visible = now
        if now:
            self.errors.clear()
            self._forget_curve()
            self.status.text = "Reading the data, loading the libraries …"


def _curve(costs: list[float]) -> dict[str, Any]:
    points = [cost for cost in costs if cost > 0]
    line = {"y": points, "mode": "lines+markers", "line": {"color": BLUE}, "marker": {"size": 4}}
    ticks = log_marks(np.array(points))
    return figure(
        [line],
        230,
        xaxis=whole_numbers("iteration", len(points)),
        yaxis=axis("cost", type="log", **ticks),
        showlegend=False,
    )

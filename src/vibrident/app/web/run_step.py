"""Start, cancel and follow a long computation: what the steps of a fit and of a task share."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, ClassVar

import numpy as np
from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.language import page_language, phrase, translate
from vibrident.app.web.task_run import TaskProgress, TaskRun
from vibrident.app.web.tasks import IDENTIFY, TaskRequest
from vibrident.app.web.translated import charts
from vibrident.app.web.user import User
from vibrident.app.web.worker import StoppedError
from vibrident.show import axes
from vibrident.show.views import LINES, Figure, Panel, Series, Stack

_PACE_S = 0.25  # seconds between two looks at the progress
_MAX_POINTS = 2000  # of a line of the growing chart
CHART_HEIGHT_PX = 230  # of the growing chart, pixels


class RunStep:
    """A section that runs something long, one at a time, and shows its progress."""

    ids: ClassVar[str]  # what the ids of its elements begin with

    def __init__(self, user: User, run: TaskRun) -> None:
        self.user = user
        self.run = run
        self.reported: TaskProgress | None = None  # whose end was shown

    def make_request(self) -> TaskRequest:
        """Return what the step asks for; InputError where something is missing."""
        raise NotImplementedError

    def subject(self, request: TaskRequest) -> str:
        """Return what was run, in words."""
        raise NotImplementedError

    def show_output(self, run: TaskProgress) -> None:
        """Show what a run made, beside its results."""

    def build_controls(
        self, label: str, share: str, on_result: Callable[..., Awaitable[Any]]
    ) -> None:
        """Build buttons, status, progress bar, errors and the growing chart.

        ``share``: name of the progress bar for a screen reader; ``on_result`` is called after
        results have joined those of the page.
        """
        self.on_result = on_result
        with frame.actions():
            self.start = frame.add_button(
                label, lambda: self.begin(self.make_request), f"id={self.ids}start"
            )
            self.stop = frame.add_button(
                translate("Cancel"),
                self.run.worker.cancel,
                f"outline color=negative id={self.ids}cancel",
            )
            self.spinner = ui.spinner(size="28px")
            self.status = ui.label("").props(f"role=status id={self.ids}status")
        self.share = ui.linear_progress(0.0, show_value=False, size="8px")
        self.share.props(f"id={self.ids}share").props["aria-label"] = share
        self.share.visible = False
        self.errors = frame.add_error_area()
        container = ui.element("div").classes("chart").props(f"id={self.ids}chart")
        self.chart = frame.GrowingChart(container, CHART_HEIGHT_PX)
        self.timer = ui.timer(_PACE_S, self._follow, active=False)

    def begin(self, make_request: Callable[[], TaskRequest]) -> None:
        """Begin a run, unless one is under way; show the error of its request."""
        if self.run.busy:
            return
        self.chart.forget()
        with frame.reporting(self.errors, self.user):
            request = make_request()
            self.user.write_form()
            self.run.start(request)
            self.update()
            self.timer.activate()
            self.status.client.run_javascript(f"vibrident.see('{self.ids}status')")

    def update(self) -> None:
        """Update buttons and visible parts."""
        self.start.set_enabled(not self.run.busy)
        self.stop.visible = self.spinner.visible = self.run.busy

    async def _follow(self) -> None:
        run = self.run.progress
        if run is None or run is self.reported:
            self.timer.deactivate()
            return
        self.status.text = run.status(page_language())
        self.share.visible = run.share is not None and not run.over
        self.share.value = run.share or 0.0
        if not run.over and self.chart.grows_to(sum(len(points) for _, points in run.lines)):
            self.chart.show(live_chart(run))
        if run.over:
            self.reported = run
            self.timer.deactivate()
            self.update()
            await self._finish(run)

    async def _finish(self, run: TaskProgress) -> None:
        """Show what a run made, or why it failed; offer to repeat one that was broken off."""
        if run.error is not None:
            frame.show_error(self.errors, run.error, self.user.session)
            if isinstance(run.error, StoppedError) and not self.errors.is_deleted:
                with self.errors:
                    subject = self.subject(run.request)
                    broken_off = translate("Broken off: {what}", what=subject)
                    frame.hint(broken_off).props(f"id={self.ids}broken-off")
                    repeat = partial(self.begin, lambda: run.request)
                    frame.add_button(translate("Repeat"), repeat, f"outline id={self.ids}repeat")
        if run.output is not None:
            self.chart.forget()
            self.show_output(run)
        if run.kept_results:
            run.kept_results = 0
            await self.on_result(go=run.request.task == IDENTIFY)


def live_chart(run: TaskProgress) -> bytes:
    """Return the chart of a task under way: costs over iterations, or a parameter over time."""
    is_cost = run.across == "cost"
    named = dict(zip(run.line_names, (points for _, points in run.lines), strict=True))
    series = []
    for number, (name, points) in enumerate(named.items()):
        line = np.array(points[-_MAX_POINTS:], dtype=float)
        x, y = line[np.isfinite(line[:, 1]) & (~is_cost | (line[:, 1] > 0))].T
        series.append(Series(x, y, name, LINES[number % len(LINES)]))
    x = np.concatenate([line.x for line in series])
    y = np.concatenate([line.y for line in series])
    if is_cost:
        x_axis = axes.linear(
            phrase("Iteration"), np.append(x, [0.0, 2.0]), whole_numbers=True, most=8
        )
        y_axis = axes.size(phrase("Cost"), y)
    else:
        x_axis = axes.linear(phrase("Time in s"), x)
        y_axis = axes.linear("", y)
    panel = Panel(x_axis, y_axis, tuple(series), 1.1)
    ((_, chart, _),) = charts(page_language(), Figure("live", "", (Stack((panel,)),)))
    return chart

"""Start, cancel and follow a long computation: what the steps of a fit and of a task share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.language import page_language, translate
from vibrident.app.web.state import Job
from vibrident.app.web.task_run import TaskProgress
from vibrident.app.web.user import User
from vibrident.app.web.worker import StoppedError

_PACE_S = 0.25  # seconds between two looks at the progress
CHART_HEIGHT_PX = 230  # of the growing chart, pixels


class RunStep(ABC):
    """A section that runs something long, one at a time, and shows its progress."""

    ids: ClassVar[str]  # what the ids of its elements begin with

    def __init__(self, user: User) -> None:
        self.user = user
        self.reported: Job | TaskProgress | None = None  # the run whose end was shown

    @property
    @abstractmethod
    def run(self) -> Job | TaskProgress | None:
        """Return the latest run."""

    @property
    @abstractmethod
    def is_busy(self) -> bool:
        """Return whether a run is under way."""

    @abstractmethod
    def draw(self, run: Any) -> None:
        """Draw the growing chart of a run, if it has grown."""

    @abstractmethod
    async def finish(self, run: Any) -> None:
        """Show what a run made, or why it failed."""

    def build_controls(
        self, label: str, on_start: Callable[..., Any], on_cancel: Callable[..., Any], share: str
    ) -> None:
        """Build buttons, status, progress bar, errors and the growing chart.

        ``share``: name of the progress bar for a screen reader.
        """
        with frame.actions():
            self.start = frame.add_button(label, on_start, f"id={self.ids}start")
            self.stop = frame.add_button(
                translate("Cancel"), on_cancel, f"outline color=negative id={self.ids}cancel"
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

    def begin(self, start: Callable[[], None]) -> None:
        """Call ``start``, which begins a run, unless one is under way; show its error."""
        if self.is_busy:
            return
        self.errors.clear()
        self.chart.forget()
        try:
            start()
        except Exception as error:
            frame.show_error(self.errors, error, self.user.session)
            return
        self.update()
        self.timer.activate()

    def update(self) -> None:
        """Update buttons and visible parts."""
        self.start.set_enabled(not self.is_busy)
        self.stop.visible = self.spinner.visible = self.is_busy

    async def _follow(self) -> None:
        run = self.run
        if run is None or run is self.reported:
            self.timer.deactivate()
            return
        self.status.text = run.status(page_language())
        self.share.visible = run.share is not None and not run.over
        self.share.value = run.share or 0.0
        self.draw(run)
        if run.over:
            self.reported = run
            self.timer.deactivate()
            self.update()
            await self.finish(run)

    def report_failure(
        self, error: Exception, subject: str, repeat: Callable[..., Any] | None
    ) -> None:
        """Show the error of a run; offer to repeat one that was broken off.

        ``subject``: what was run.
        """
        frame.show_error(self.errors, error, self.user.session)
        if isinstance(error, StoppedError) and repeat and not self.errors.is_deleted:
            with self.errors:
                broken_off = translate("Broken off: {what}", what=subject)
                frame.hint(broken_off).props(f"id={self.ids}broken-off")
                frame.add_button(translate("Repeat"), repeat, f"outline id={self.ids}repeat")

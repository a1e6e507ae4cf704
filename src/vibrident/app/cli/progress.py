"""Show a progress bar on stderr for steps longer than a second, if stderr is a terminal."""

from __future__ import annotations

import contextlib
import os
import threading
from types import TracebackType
from typing import TYPE_CHECKING

from vibrident.app.cli.console import error_console, note
from vibrident.app.workflow.interruption import tidied_up
from vibrident.base.progress import ProgressReporter

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


class ProgressBar(ProgressReporter):
    """Show the current step, and an optimiser's progress when called with it."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._lock = threading.Lock()
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        self._timer: threading.Timer | None = None
        self._open = contextlib.ExitStack()

    def __enter__(self) -> ProgressBar:
        console = error_console()
        if not console.is_terminal or console.is_dumb_terminal:
            return self
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(24),
            TimeElapsedColumn(),
        )
        self._bar = Progress(*columns, console=console, transient=True)
        self._task = self._bar.add_task(self._what, total=None)
        self._timer = threading.Timer(1.0, self._show)
        self._timer.daemon = True
        self._open.enter_context(tidied_up(self._restore))
        self._timer.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._timer is not None:
            self._timer.cancel()
        with self._lock:
            bar = self._bar
            self._bar = None
            if bar is not None and bar.live.is_started:
                bar.stop()
        self._open.close()

    def __call__(self, iteration: int, most: int, cost: float) -> None:
        """Show an optimiser's progress; see ``vibrident.fit.optimise.Progress``."""
        self.share(
            f"{self._what}: iteration {iteration} of at most {most}, cost {cost:.4g}",
            iteration,
            most,
        )

    @property
    def is_shown(self) -> bool:
        """Return whether stderr is a terminal."""
        return self._bar is not None

    def share(self, words: str, done: int, most: int) -> None:
        """Show a text and the part done."""
        bar = self._bar
        task = self._task
        if bar is not None and task is not None:
            bar.update(task, description=words, completed=done, total=most)

    def step(self, words: str) -> None:
        """Show that another step begins."""
        self._what = words
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=words, completed=0, total=None)

    def note(self, words: str) -> None:
        """Say a remark in a line of its own."""
        note(words)

    def _show(self) -> None:
        with self._lock:
            if self._bar is not None:
                self._bar.start()

    def _restore(self) -> None:
        if self._bar is not None and self._bar.live.is_started:
            # clears the line and shows the cursor, which the bar hides
            os.write(2, b"\r\x1b[2K\x1b[?25h")

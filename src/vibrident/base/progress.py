"""Report the progress of a task to a command line or a page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class ProgressReporter:
    """Receives the progress of a task; this one reports nothing."""

    def step(self, words: str) -> None:
        """Report the name of the step that begins."""

    def __call__(self, iteration: int, most: int, cost: float) -> None:
        """Report the progress of an optimiser; see ``vibrident.fit.optimise.Progress``."""

    def share(self, words: str, done: int, most: int) -> None:
        """Report how many parts of the work are done."""

    def estimate(self, row: Any, units: Mapping[str, str]) -> None:
        """Report a tracked sensor at a time, a ``TrackedEstimate``, in these units."""

    def note(self, words: str) -> None:
        """Report a remark that is worth a line of its own."""


SILENT = ProgressReporter()

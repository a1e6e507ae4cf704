"""Define the output of a task and its progress, for command line and page alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vibrident.show.views import Figure, Sentence, Table
    from vibrident.use.tracking.state import TrackedEstimate


@dataclass(frozen=True)
class TaskOutput:
    """Tables, sentences and figures of a task, whose files lie in the folder it was given."""

    blocks: tuple[Table | Sentence, ...]
    figures: tuple[Figure, ...] = ()
    findings: tuple[Any, ...] = ()  # of the data, each with ``code`` and ``message``
    notes: tuple[str, ...] = ()  # further remarks


class ProgressReporter:
    """Receives the progress of a task; this one reports nothing."""

    def step(self, words: str) -> None:
        """Report the name of the step that begins."""

    def __call__(self, iteration: int, most: int, cost: float) -> None:
        """Report the progress of an optimiser; see ``vibrident.fit.optimise.Progress``."""

    def share(self, words: str, done: int, most: int) -> None:
        """Report how many parts of the work are done."""

    def estimate(self, row: TrackedEstimate, units: Mapping[str, str]) -> None:
        """Report a tracked sensor at a time, in these units."""

    def note(self, words: str) -> None:
        """Report a remark that is worth a line of its own."""


SILENT = ProgressReporter()

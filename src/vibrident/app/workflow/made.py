"""What a task made, to be shown by the command line and by the page alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vibrident.show.views import Figure, Sentence, Table
    from vibrident.use.tracking.state import Estimate


@dataclass(frozen=True)
class Made:
    """Tables, sentences and figures of a task, whose files lie in the folder that it was given."""

    blocks: tuple[Table | Sentence, ...]
    figures: tuple[Figure, ...] = ()
    findings: tuple[Any, ...] = ()  # of the data, each with ``code`` and ``message``
    notes: tuple[str, ...] = ()  # further remarks


class Teller:
    """Who is told how a task goes on; this one tells nobody."""

    def step(self, words: str) -> None:
        """Tell the name of the step that begins."""

    def __call__(self, iteration: int, most: int, cost: float) -> None:
        """Tell the progress of an optimiser; see ``vibrident.fit.optimise.Progress``."""

    def share(self, words: str, done: int, most: int) -> None:
        """Tell how many parts of the whole are done."""

    def estimate(self, row: Estimate, units: Mapping[str, str]) -> None:
        """Tell a tracked sensor at a time, in these units."""

    def note(self, words: str) -> None:
        """Tell a remark that is worth a line of its own."""


SILENT = Teller()

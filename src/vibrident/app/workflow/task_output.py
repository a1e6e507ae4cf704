"""Define the output of a task, for command line and page alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vibrident.show.views import Figure, Sentence, Table


@dataclass(frozen=True)
class TaskOutput:
    """Tables, sentences and figures of a task, whose files lie in the folder it was given."""

    blocks: tuple[Table | Sentence, ...]
    figures: tuple[Figure, ...] = ()
    findings: tuple[Any, ...] = ()  # of the data, each with ``code`` and ``message``
    notes: tuple[str, ...] = ()  # further remarks

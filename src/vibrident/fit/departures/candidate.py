"""A place where a departure may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vibrident.data.records import FloatArray
from vibrident.fit.departures.score import Sums


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place where a departure may be.

    Attributes:
        words: what it is there.
        sums: of its columns.
        white: its whitened columns, one set a part that has them; none where they are made ``exactly``.
        time_s: where in the record; None where it has no place.
        record: name of the record; None for that of the part, or all.
        exactly: makes the same with its columns whitened one by one, where the sums approximate that; None where not.
    """

    words: str
    sums: Sums
    white: Callable[[], tuple[FloatArray, ...]] = tuple
    time_s: float | None = None
    record: str | None = None
    exactly: Callable[[], Candidate] | None = None

"""Places where a departure may be."""

from __future__ import annotations

from dataclasses import dataclass

from vibrident.data.records import FloatArray
from vibrident.fit.departures.score import Sums


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place where a departure may be.

    Attributes:
        words: what it is there.
        number: of the place among those of the departure.
        time_s: where in the record; None where it has no place.
        record: name of the record; None for that of the part, or all.
        rows: columns of a place among points, in standard deviations, shape (m, rows); None of one in records.
    """

    words: str
    number: int = 0
    time_s: float | None = None
    record: str | None = None
    rows: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Places:
    """Places with as many columns each, and what these have in common with the fit, stacked."""

    candidates: tuple[Candidate, ...]
    sums: Sums

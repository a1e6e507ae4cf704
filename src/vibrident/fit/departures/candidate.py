"""Places where a departure may be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from vibrident.data.records import FloatArray
from vibrident.fit.departures.score import Sums
from vibrident.fit.response.response import ComplexArray


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place where a departure may be.

    Attributes:
        words: what it is there.
        columns: makes its columns, one set a part that has them: in time, by bins, or of points.
        time_s: where in the record; None where it has no place.
        record: name of the record; None for that of the part, or all.
        exactly: sums of its columns whitened one by one, where those of the place approximate that; None where not.
    """

    words: str
    columns: Callable[[], tuple[FloatArray | ComplexArray, ...]]
    time_s: float | None = None
    record: str | None = None
    exactly: Callable[[], Sums] | None = None


@dataclass(frozen=True, eq=False)
class Places:
    """Places with as many columns each, and what these have in common with the fit, stacked."""

    candidates: tuple[Candidate, ...]
    sums: Sums

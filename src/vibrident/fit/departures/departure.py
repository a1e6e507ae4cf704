"""A departure from the fit: the columns that it adds to the response, and what is said of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.candidate import Candidate
from vibrident.fit.departures.part import Part
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.score import Score, Sums
from vibrident.fit.measure.response import ComplexArray


@dataclass(frozen=True)
class Scale:
    """Largest motion of all parts, edges of bands of like information, Hz, and the number of parts."""

    motion: float
    bands_hz: tuple[float, ...]
    parts: int

    @classmethod
    def of(cls, parts: Sequence[Part], bands: int) -> Scale:
        """Of all parts, with so many bands."""
        largest = (float(np.max(np.abs(part.motion), initial=0.0)) for part in parts)
        motion = max(float(np.finfo(float).tiny), *largest)
        top = 0.5 * max(part.rate_hz for part in parts)
        edges, power = np.linspace(0.0, top, 401), np.zeros(400)
        for part in parts:
            own = np.sum(np.abs(np.fft.rfft(part.jacobian, axis=-1)) ** 2, axis=0) * (part.whitening > 0.0)
            power += np.histogram(np.arange(own.size) * part.rate_hz / part.samples, edges, weights=own)[0]
        total = np.cumsum(power)
        inner = np.searchsorted(total, total[-1] * np.arange(1, bands) / bands)
        return cls(motion, (0.0, *np.unique(edges[inner + 1]).tolist(), top), len(parts))


#: Columns that sums over blocks approximate tell nothing where the parameters leave less than this part, in squares.
WITHIN_BLOCKS = 1e-2


class Departure(ABC):
    """A departure; a module of ``fit/departures/kinds`` holds one, and so does an entry point.

    Attributes:
        name: of the kind.
        code: of the warning where it matters.
        pooled: whether the records share its amounts.
        own_columns: whether its columns are tested for what each moves, as each may be there without the others.
        linear: whether its columns are linear in the motion: an error of the reference's noise is then in common with
            them.
        of_light: whether it is looked for in a sine by an interferometer's raw light, whose noise is filtered around
            the tone as no spectrum of a record shows.
        joint: whether what several move is what the fit beside all of them moves; else it is the sum.
    """

    name: ClassVar[str]
    code: ClassVar[WarningCode]
    pooled: ClassVar[bool] = True
    own_columns: ClassVar[bool] = False
    linear: ClassVar[bool] = True
    of_light: ClassVar[bool] = False
    joint: ClassVar[bool] = True

    @abstractmethod
    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, FloatArray | ComplexArray]]:
        """For each place what it is in words, and its columns in time, shape (m, n), or by bins, shape (m, bins)."""

    def candidates(self, part: Part, scale: Scale, parameters: int) -> list[Candidate]:
        """All places of a part."""
        found = list(self.columns(part, scale))
        if not found:
            return []
        white = [part.white(columns) for _, columns in found]
        return [
            Candidate(words, Sums.of(part, own, parameters, linear=self.linear), partial(alone, own))
            for (words, _), own in zip(found, white, strict=True)
        ]

    def at_points(self, points: PointsPart) -> list[Candidate]:
        """All places of a response at points; none where the departure shows in records only."""
        return []

    def code_of(self, candidate: Candidate, score: Score) -> WarningCode:
        """Code of the warning where it matters."""
        return self.code

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """What is there, without place and impact; a clause that ends without a stop."""
        return candidate.words


def alone(columns: FloatArray) -> tuple[FloatArray, ...]:
    """The columns of a departure of one part."""
    return (columns,)


@dataclass(frozen=True, eq=False)
class InTime:
    """A change at a time.

    Attributes:
        time_s: of a step; None for a ramp.
        behind: part of the motion's power behind it.
        factor: of each block, shape (blocks,).
        edges: of the blocks, in samples, shape (blocks + 1,).
        sums: of all that a change adds (:attr:`Part.changing`), each times the factor.
    """

    time_s: float | None
    behind: float
    factor: FloatArray
    edges: NDArray[np.int_]
    sums: Sums


def in_steps(part: Part, blocks: int, parameters: int) -> Iterator[InTime]:
    """Sums of all that a change adds, each times a step in time or a ramp, by sums over blocks.

    Whitening and a slow factor commute but for the whitening filter's length, so one filtering serves all places (sup
    over places: Andrews 1993).
    """
    rows = part.changing_white
    edges = np.linspace(0, part.samples, blocks + 1).astype(int)
    own, other = [], np.concatenate([rows, part.basis, part.jacobian, part.residual[None]])
    for first, last in pairwise(edges.tolist()):
        block, loud = rows[:, first:last], rows[:, first:last] * part.profile[first:last]
        own.append(
            (
                block @ other[:, first:last].T,
                loud @ rows[:, first:last].T,
                loud @ part.jacobian[:, first:last].T,
                part.in_common(block, slice(first, last)),
            )
        )
    products, spreads, crossed, commons = (np.array(each) for each in zip(*own, strict=True))
    m, q, p = len(rows), len(part.basis), len(part.jacobian)
    power = np.cumsum(products[:, 0, 0])
    behind = 1.0 - power / max(float(power[-1]), np.finfo(float).tiny)
    middles = (np.arange(blocks) + 0.5) / blocks  # zero at the begin: parameters are those before a change
    steps = [(np.arange(blocks) >= b) * 1.0 for b in range(1, blocks)]
    for number, factor in enumerate(np.array([*steps, middles], dtype=float)):
        once, twice = np.tensordot(factor, products, 1), np.tensordot(factor**2, products[:, :, :m], 1)
        freed = once[:, m : m + q]
        gram = twice - freed @ freed.T
        sums = Sums(
            once[:, -1],
            gram,
            np.tensordot(factor**2, spreads, 1) - freed @ freed.T,
            once[:, m + q : m + q + p],
            np.tensordot(factor, crossed, 1),
            np.tensordot(factor, commons, 1),
            np.zeros((m, parameters)),
            WITHIN_BLOCKS * np.diag(twice),
            part.steps,
        ).beside(part, parameters)
        if number == len(steps):
            yield InTime(None, 0.5, factor, edges, sums)
        else:
            yield InTime(part.begin_s + edges[number + 1] / part.rate_hz, float(behind[number]), factor, edges, sums)

"""A departure from the fit: the columns that it adds to the response, and what is said of it."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray, Record
from vibrident.fit.departures.candidate import Candidate, Places
from vibrident.fit.departures.part import Part
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.score import Score, Sums
from vibrident.fit.response.response import ComplexArray


@dataclass(frozen=True)
class Scale:
    """What is common to all records.

    Attributes:
        motion: largest size of a predicted response about its mean.
        bands_hz: edges of bands of like information.
        records: number of records.
        narrow: whether the noise of a sine is an interferometer's light.
    """

    motion: float
    bands_hz: tuple[float, ...]
    records: int
    narrow: bool


#: Columns that sums over blocks approximate tell nothing where the parameters leave less than this part, in squares.
WITHIN_BLOCKS = 1e-2


class Departure(ABC):
    """A departure; a module of ``fit/departures/kinds`` holds one, and so does an entry point.

    Attributes:
        name: of the kind.
        code: of the warning where it matters.
        pooled: whether the records share its amounts.
        own_columns: whether its columns are tested for what each moves, as each may be there without the others.
        of_light: whether it is looked for in a sine by an interferometer's raw light, whose noise is filtered around
            the tone as no spectrum of a record shows.
        joint: whether what several move is what the fit beside all of them moves; else it is the sum.
        family: kinds of one family stand for one thing, none of them exactly: what several move is told together.
        within: whether it is told within a record, beside parameters that are the record's alone.
        together: whether all records, each with amounts of its own, are tested together, too.
        approximate: whether the sums of its places are approximate, and :meth:`exact` makes those of one.
        nuisance: whether the fit of a record can have it as nuisance parameters (:meth:`beside`).
    """

    name: ClassVar[str]
    code: ClassVar[WarningCode]
    pooled: ClassVar[bool] = True
    own_columns: ClassVar[bool] = False
    of_light: ClassVar[bool] = False
    joint: ClassVar[bool] = True
    family: ClassVar[str] = ""
    within: ClassVar[bool] = False
    together: ClassVar[bool] = False
    approximate: ClassVar[bool] = False
    nuisance: ClassVar[bool] = False

    @abstractmethod
    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, FloatArray | ComplexArray]]:
        """For each place what it is in words, and its columns: all in time, shape (m, n), or all by bins, (m, bins)."""

    def places(self, part: Part, scale: Scale, parameters: int) -> list[Places]:
        """All places of a part; ``parameters``: number P of the coordinates."""
        found = list(self.columns(part, scale))
        if not found:
            return []
        together: Any = np.concatenate([columns for _, columns in found])
        white = part.white(together)
        last = np.cumsum([len(columns) for _, columns in found])
        rows = [range(end - len(columns), end) for end, (_, columns) in zip(last.tolist(), found, strict=True)]
        sums = Sums.of(part, white, parameters, self.doubt(part, scale, len(white)))
        every = enumerate(zip(found, rows, strict=True))
        return in_widths([(Candidate(words, number), sums.some(own)) for number, ((words, _), own) in every])

    def columns_of(self, candidate: Candidate, part: Part, scale: Scale) -> FloatArray | ComplexArray:
        """Those of a place."""
        return next(itertools.islice(self.columns(part, scale), candidate.number, None))[1]

    def whitened(self, candidate: Candidate, part: Part, scale: Scale) -> FloatArray:
        """Those of a place as its test has them, free of the nuisance parameters, shape (m, n)."""
        return part.white(self.columns_of(candidate, part, scale))

    def exact(self, candidate: Candidate, part: Part, scale: Scale, parameters: int) -> Sums:
        """Of the columns of a place by themselves, where the sums of places approximate that."""
        raise NotImplementedError

    def doubt(self, part: Part, scale: Scale, count: int) -> FloatArray | None:
        """What so many columns have in common with an error of the reference's noise; as of :meth:`Sums.of`."""
        return None

    def at_points(self, points: PointsPart) -> list[tuple[Candidate, Sums]]:
        """All places of a response at points, with their sums; none where the departure shows in records only."""
        return []

    def beside(self, record: Record) -> Record:
        """The record with the departure as nuisance parameters of its fit; itself where it has these."""
        return record

    def code_of(self, candidate: Candidate, score: Score) -> WarningCode:
        """Code of the warning where it matters."""
        return self.code

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """What is there, without place and impact; a clause that ends without a stop."""
        return candidate.words


class WithoutMotion(Departure):
    """A departure of which the columns do not depend on the motion, nor on noise in it."""

    def doubt(self, part: Part, scale: Scale, count: int) -> FloatArray:
        """None of it."""
        return np.zeros(count)


class Shape(Departure):
    """A departure by functions without memory of the response's motion, or of the reference's.

    Attributes:
        of_reference: whether they are of the reference; the sensor answers them.
        through: whether the sensor answers those of the response, too.
        turned: whether each has its quadrature beside it.

    One function without memory may take several of these: a soft limit is a level and a cube, a dead band two levels.
    """

    family: ClassVar[str] = "shape"
    of_reference: ClassVar[bool] = False
    through: ClassVar[bool] = False
    turned: ClassVar[bool] = False

    @abstractmethod
    def shapes(self, motion: FloatArray, scale: Scale, largest: float) -> Iterable[tuple[str, FloatArray]]:
        """For each what it is in words, and the function of the motion, each of shape (n,).

        ``largest``: of the motion of this part; that of all is in the scale.
        """

    def _series(self, part: Part) -> tuple[FloatArray, float]:
        motion = part.reference if self.of_reference else part.motion
        return motion, float(np.max(np.abs(motion), initial=0.0))

    def columns(self, part: Part, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """The functions by their bins."""
        (motion, largest), nothing = self._series(part), np.zeros(part.whitening.size, dtype=complex)
        for words, shape in self.shapes(motion, scale, largest):
            there = bool(shape.any())
            bins = np.asarray(np.fft.rfft(shape * part.used)) * self._answer(part) if there else nothing
            yield words, np.stack([bins, 1j * bins] if self.turned else [bins])

    def _answer(self, part: Part) -> ComplexArray | float:
        size = float(np.max(np.abs(part.transfer), initial=0.0)) or 1.0
        return part.transfer if self.of_reference else part.transfer / size if self.through else 1.0

    def doubt(self, part: Part, scale: Scale, count: int) -> FloatArray:
        """Mean of a column times the residual e = −η, where the motion holds η: −Σ E[f(y + η) η] |W|² of the bins.

        By the two nodes y ± σ of Gauss and Hermite's quadrature.
        """
        (motion, largest), n = self._series(part), part.samples
        power = np.divide(part.doubt, part.whitening**2, out=np.zeros_like(part.doubt), where=part.whitening > 0.0)
        gain = np.abs(part.transfer) ** 2 if self.of_reference else np.ones(power.size)
        power = np.divide(power, gain, out=np.zeros_like(power), where=gain > 0.0)
        sigma = float(np.sqrt(2.0 * np.sum(power) / n)) if largest > 0.0 else 0.0
        share = 2.0 / n * float(np.sum(part.doubt * (np.real(self._answer(part)) if self.through else 1.0)))
        ends = [[shape for _, shape in self.shapes(motion + sign * sigma, scale, largest)] for sign in (1.0, -1.0)]
        slope = -0.5 * share / sigma if sigma > 0.0 else 0.0
        found = [slope * float(np.sum((up - down) * part.used)) for up, down in zip(*ends, strict=True)]
        return np.array([one for each in found for one in ([each, 0.0] if self.turned else [each])])


def in_widths(every: Sequence[tuple[Candidate, Sums]]) -> list[Places]:
    """Places with the sums of each, those of as many columns together."""
    widths = dict.fromkeys(len(sums.score) for _, sums in every)
    some = [[one for one in every if len(one[1].score) == width] for width in widths]
    return [Places(tuple(one for one, _ in own), Sums.stacked([sums for _, sums in own])) for own in some]


@dataclass(frozen=True, eq=False)
class InTime:
    """Steps at the places between blocks of a record, and behind them a ramp.

    Attributes:
        time_s: of each step, shape (blocks − 1,).
        behind: part of the motion's power behind each, shape (blocks − 1,).
        sums: of all that a change adds (:attr:`Part.changing`), each times the factor.
    """

    time_s: FloatArray
    behind: FloatArray
    sums: Sums


def edges_of(samples: int, blocks: int) -> NDArray[np.int_]:
    """Of the blocks of a record, in samples, shape (blocks + 1,)."""
    return np.linspace(0, samples, blocks + 1).astype(int)


def factors_of(blocks: int) -> FloatArray:
    """Of each step, and of the ramp, in each block, shape (blocks, blocks)."""
    number = np.arange(blocks)
    ramp = (number + 0.5) / blocks  # zero at the begin: parameters are those before a change
    return np.concatenate([number >= number[1:, None], ramp[None]], dtype=float)


def in_steps(part: Part, blocks: int, parameters: int) -> InTime:
    """Sums of all that a change adds, each times a step in time or a ramp, by sums over blocks.

    Whitening and a slow factor commute but for the whitening filter's length, so one filtering serves all places (sup
    over places: Andrews 1993).
    """
    rows = part.changing
    edges = edges_of(part.samples, blocks)
    doubt = part.in_common(rows)[:, -1] / part.samples  # noise is in all of the record, whenever the motion is
    own, other = [], np.concatenate([rows, part.basis, part.jacobian, part.residual[None]])
    for first, last in itertools.pairwise(edges.tolist()):
        block, loud = rows[:, first:last], rows[:, first:last] * part.profile[first:last]
        common = part.in_common(block, slice(first, last))
        common[:, -1] = doubt * (last - first)
        own.append(
            (
                block @ other[:, first:last].T,
                loud @ rows[:, first:last].T,
                loud @ part.jacobian[:, first:last].T,
                common,
            )
        )
    products, spreads, crossed, commons = (np.array(each) for each in zip(*own, strict=True))
    m, q, p = len(rows), len(part.basis), len(part.jacobian)
    power = np.cumsum(products[:, 0, 0])
    factors = factors_of(blocks)
    once, squared = np.tensordot(factors, products, 1), np.tensordot(factors**2, products[:, :, :m], 1)
    freed = once[:, :, m : m + q]
    taken = freed @ freed.mT
    sums = Sums(
        once[:, :, -1],
        squared - taken,
        np.tensordot(factors**2, spreads, 1) - taken,
        once[:, :, m + q : m + q + p],
        np.tensordot(factors, crossed, 1),
        np.tensordot(factors, commons, 1),
        np.zeros((blocks, m, parameters)),
        WITHIN_BLOCKS * np.diagonal(squared, axis1=1, axis2=2),
        np.full(blocks, part.steps),
    ).beside(part, parameters)
    behind = 1.0 - power[:-1] / max(float(power[-1]), np.finfo(float).tiny)
    return InTime(part.begin_s + edges[1:-1] / part.rate_hz, behind, sums)

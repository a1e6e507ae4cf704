"""A departure from the fit: the columns that it adds to the response, and what is said of it."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import Point, PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.departures.sums import Exact, Sums
from vibrident.fit.response.response import ComplexArray


@dataclass(frozen=True)
class Scale:
    """What is common to all records.

    Attributes:
        motion: largest size of a predicted response about its mean.
        bands_hz: edges of bands of like information.
        records: number of records.
        narrow: whether the noise of a sine is an interferometer's light.
        mass: at frequencies in Hz, velocity of the sensor's mass in its case for an acceleration of one, and response
            to that; None where the sensor is no oscillator.
    """

    motion: float
    bands_hz: tuple[float, ...]
    records: int
    narrow: bool
    mass: Callable[[FloatArray], tuple[ComplexArray, ComplexArray]] | None = None


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place where a departure may be.

    Attributes:
        words: what it is there.
        number: of the place among those of the departure.
        time_s: where in the record; None where it has no place.
    """

    words: str
    number: int = 0
    time_s: float | None = None


@dataclass(frozen=True, eq=False)
class Places:
    """Places with as many columns each, in each record of a group.

    Attributes:
        candidates: the places.
        sums: what their columns have in common with the fit, shape (R, places, …).
        there: whether a record has a place, shape (R, places).
    """

    candidates: tuple[Candidate, ...]
    sums: Sums
    there: BoolArray


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
        together: whether all records, each with amounts of its own, are tested together, too; it is told within each.
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
    nuisance: ClassVar[bool] = False

    @abstractmethod
    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """For each place what it is in words, and its columns by the bins, shape (R or 1, m, K)."""

    def places(self, group: WhitenedGroup, scale: Scale) -> list[Places]:
        """All places in a group."""
        every = list(self.columns(group, scale))
        made = list[Places]()
        for width in dict.fromkeys(columns.shape[-2] for _, columns in every):
            own = [(number, *one) for number, one in enumerate(every) if one[1].shape[-2] == width]
            rows = np.empty((len(group.records), len(own), width, 2 * group.bins))
            for place, (_, _, columns) in enumerate(own):
                group.flat(columns, rows[:, place])
            candidates = tuple(Candidate(words, number) for number, words, _ in own)
            sums = group.sums(rows)
            made.append(Places(candidates, sums, np.ones(sums.score.shape[:2], dtype=bool)))
        return made

    def columns_of(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """Those of a place."""
        return next(itertools.islice(self.columns(group, scale), candidate.number, None))[1]

    def whitened(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Those of a place as whitened rows, shape (R, m, 2 K)."""
        return group.flat(self.columns_of(candidate, group, scale))

    def doubt(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray | None:
        """What its columns have in common with an error of the reference's noise, shape (R, m).

        None: they are linear in the motion, and :attr:`WhitenedGroup.errors` tell it.
        """
        return None

    def refined(
        self, candidate: Candidate, group: WhitenedGroup, scale: Scale, sums: Exact
    ) -> tuple[Candidate, Exact]:
        """A place as its test and sentence see it, with the sums of its columns in each record."""
        return candidate, sums

    def at_points(self, points: PointsPart) -> list[Point]:
        """All places of a response at points; none where the departure shows in records only."""
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

    def doubt(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """None of it."""
        return np.zeros(1)


class Shape(Departure):
    """A departure by functions without memory of a signal.

    One function without memory may take several of these: a soft limit is a level and a cube, a dead band two levels.

    Attributes:
        turned: whether each has its quadrature beside it.
    """

    family: ClassVar[str] = "shape"
    turned: ClassVar[bool] = False

    @abstractmethod
    def shapes(
        self, signal: FloatArray, scale: Scale, largest: FloatArray
    ) -> Iterable[tuple[str, FloatArray]]:
        """For each what it is in words, and the function of the signal, each of shape (R, L).

        ``largest``: of the signal of each record, shape (R, 1); that of all is in the scale.
        """

    def signal(self, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """The signal that it is a function of, shape (R, L): the response's motion."""
        return group.motion

    def answer(self, group: WhitenedGroup, scale: Scale) -> ComplexArray | float:
        """What the functions pass through on their way to the response, shape (R, K) or (K,)."""
        return 1.0

    def gain(self, group: WhitenedGroup, scale: Scale) -> ComplexArray | float:
        """By which noise of the response enters the signal: its inverse does the reverse, shape (R, K) or (K,)."""
        return 1.0

    def _shapes(
        self, group: WhitenedGroup, scale: Scale, signal: FloatArray
    ) -> list[tuple[str, FloatArray]]:
        largest = np.max(np.abs(self.signal(group, scale)), axis=1, keepdims=True, initial=0.0)
        return list(self.shapes(signal, scale, largest))

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """The functions by their bins."""
        for words, shape in self._shapes(group, scale, self.signal(group, scale)):
            yield words, self._by_bins(shape, group, scale)

    def columns_of(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """One function by its bins."""
        _, shape = self._shapes(group, scale, self.signal(group, scale))[candidate.number]
        return self._by_bins(shape, group, scale)

    def _by_bins(self, shape: FloatArray, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        bins = group.bins_of(shape) * self.answer(group, scale)
        return np.stack([bins, 1j * bins] if self.turned else [bins], axis=1)

    def doubt(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Mean of a column times the residual e = −η, where the motion holds η: −Σ E[f(y + η) η] |W|² of the bins.

        By the two nodes y ± σ of Gauss and Hermite's quadrature.
        """
        n = group.samples
        signal = self.signal(group, scale)
        noise = np.divide(
            2.0, n * group.gain**2, out=np.zeros_like(group.gain), where=group.gain > 0.0
        )
        gain = np.broadcast_to(np.asarray(self.gain(group, scale), dtype=complex), group.gain.shape)
        doubt = group.errors.doubt
        answer = np.asarray(self.answer(group, scale), dtype=complex)
        power = doubt * noise * np.abs(gain) ** 2
        sigma = np.sqrt(2.0 * np.sum(power, axis=1) / n)
        share = 2.0 / n * np.sum(doubt * np.real(answer * gain), axis=1)
        ends = [
            self._shapes(group, scale, signal + sign * sigma[:, None])[candidate.number][1]
            for sign in (1, -1)
        ]
        step = n // signal.shape[1]
        slope = np.divide(-0.5 * share, sigma, out=np.zeros_like(sigma), where=sigma > 0.0)
        made = slope * np.sum((ends[0] - ends[1]) * group.used[:, ::step], axis=1) * step
        return np.stack([made, np.zeros_like(made)] if self.turned else [made], axis=1)


class OfReference(Shape):
    """A departure by functions without memory of the reference, which the sensor answers."""

    def signal(self, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """The most likely motion at the sensor's input."""
        return group.reference

    def answer(self, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """The sensor's."""
        return group.transfer

    def gain(self, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """One over the sensor's."""
        return np.divide(
            1.0, group.transfer, out=np.zeros_like(group.transfer), where=group.transfer != 0.0
        )


def pooled(before: Sequence[Places], more: Sequence[Places]) -> list[Places]:
    """Places whose amounts records share; none where one group has none."""
    if not before or not more:
        return []
    return [
        replace(one, sums=one.sums + other.sums) for one, other in zip(before, more, strict=True)
    ]

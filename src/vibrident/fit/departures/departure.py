"""A departure from the fit: the columns that it adds to the response, and the sentence on it."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import Point, PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.departures.sums import ExactSums, Sums
from vibrident.fit.response.response import ComplexArray

#: A signal has its own sign beyond so many standard deviations of the noise in it: below these the
#: noise reverses it, beyond them in one of 16,000 samples.
MIN_SIGN_DEVIATIONS = 4.0


@dataclass(frozen=True)
class Scale:
    """Properties that all records of a fit share.

    Attributes:
        motion: largest size of a predicted response about its mean.
        bands_hz: edges of bands of like information.
        records: number of records.
        narrow: whether the noise of a sine is an interferometer's light.
        mass: at frequencies in Hz, velocity of the sensor's mass in its case for an acceleration of
            one, and response to that; None where the sensor is no oscillator.
        add_ons: names of those of the model, whose parameters are no departures.
    """

    motion: float
    bands_hz: tuple[float, ...]
    records: int
    narrow: bool
    mass: Callable[[FloatArray], tuple[ComplexArray, ComplexArray]] | None = None
    add_ons: frozenset[str] = frozenset()


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
        sums: products of their columns with the fit, shape (R, places, …).
        present: whether a record has a place, shape (R, places).
    """

    candidates: tuple[Candidate, ...]
    sums: Sums
    present: BoolArray


class Departure(ABC):
    """A departure; a module of ``fit/departures/kinds`` holds one, and so does an entry point.

    Attributes:
        name: of the kind.
        code: of the warning where it matters.
        pooled: whether the records share its amounts.
        compares_records: whether it is a record's difference from the others; never in all records.
        own_columns: whether its columns are tested for what each moves, as each may be there
            without the others.
        of_light: whether it is looked for in a sine by an interferometer's raw light, whose noise
            is filtered around the tone as no spectrum of a record shows.
        joint: whether what several move is what the fit beside all of them moves; else it is the
            sum.
        family: kinds of one family stand for one thing, none of them exactly: one shift is stated
            for several of them.
        within: whether it is tested within a record, beside parameters that are the record's alone.
        together: whether all records, each with amounts of its own, are tested together, too; it is
            stated of each.
        nuisance: whether the fit of a record can have it as nuisance parameters (:meth:`beside`).
    """

    name: ClassVar[str]
    code: ClassVar[WarningCode]
    pooled: ClassVar[bool] = True
    compares_records: ClassVar[bool] = False
    own_columns: ClassVar[bool] = False
    of_light: ClassVar[bool] = False
    joint: ClassVar[bool] = True
    family: ClassVar[str] = ""
    within: ClassVar[bool] = False
    together: ClassVar[bool] = False
    nuisance: ClassVar[bool] = False

    @abstractmethod
    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield each place's words and its columns by the bins, shape (R or 1, m, K)."""

    def places(self, group: WhitenedGroup, scale: Scale) -> list[Places]:
        """Return all places in a group, those with as many columns each together."""
        columns_by_place = list(self.columns(group, scale))
        places = list[Places]()
        for width in dict.fromkeys(columns.shape[-2] for _, columns in columns_by_place):
            same_width = [
                (number, *entry)
                for number, entry in enumerate(columns_by_place)
                if entry[1].shape[-2] == width
            ]
            rows = np.empty((len(group.records), len(same_width), width, 2 * group.bins))
            for place, (_, _, columns) in enumerate(same_width):
                group.whiten(columns, rows[:, place])
            candidates = tuple(Candidate(words, number) for number, words, _ in same_width)
            sums = group.sums(rows)
            places.append(Places(candidates, sums, np.ones(sums.score.shape[:2], dtype=bool)))
        return places

    def columns_of(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """Return the columns of a place by bins, shape (R or 1, m, K)."""
        return next(itertools.islice(self.columns(group, scale), candidate.number, None))[1]

    def whitened(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return the columns of a place as whitened rows, shape (R, m, 2 K)."""
        return group.whiten(self.columns_of(candidate, group, scale))

    def doubt(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray | None:
        """Return the products of a place's columns with an error of the reference's noise, (R, m).

        None: they are linear in the motion, and :attr:`WhitenedGroup.errors` tell it.
        """
        return None

    def refined(
        self, candidate: Candidate, group: WhitenedGroup, scale: Scale, sums: ExactSums
    ) -> tuple[Candidate, ExactSums]:
        """Return a place as its test and sentence see it, and the sums of its columns.

        ``sums``: of the columns of :meth:`whitened`, in each record.
        """
        return candidate, sums

    def at_points(self, points: PointsPart) -> list[Point]:
        """Return all places of a response at points.

        There are none where the departure shows in records only.
        """
        return []

    def with_nuisances(self, record: Record) -> Record:
        """Return the record with the departure as nuisance parameters of its fit.

        It is the record itself where that has these already.
        """
        return record

    def code_of(self, candidate: Candidate, score: Score) -> WarningCode:
        """Return the code of the warning where the departure matters."""
        return self.code

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return what is there, without place and impact: a clause that ends without a stop."""
        return candidate.words


class WithoutMotion(Departure):
    """A departure of which the columns do not depend on the motion, nor on noise in it."""

    def doubt(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return zero: the columns have nothing in common with the reference's noise."""
        return np.zeros(1)


class Size(NamedTuple):
    """Sizes that functions of a signal are relative to.

    Attributes:
        scale: of all records.
        largest: of the signal of each record, shape (R, 1); that of all is in the scale.
        noise: standard deviation of the reference's noise in the signal, shape (R, 1).
    """

    scale: Scale
    largest: FloatArray
    noise: FloatArray

    def sign(self, signal: FloatArray) -> FloatArray:
        """Return the sign of a signal, zero where noise of the reference may reverse it.

        There the sign is that of the noise, which is in the residual, too.
        """
        return np.sign(signal) * (np.abs(signal) > MIN_SIGN_DEVIATIONS * self.noise)


class Shape(Departure):
    """A departure by functions without memory of a signal.

    One function without memory may take several of these: a soft limit is a level and a cube, a
    dead band two levels.

    Attributes:
        turned: whether each has its quadrature beside it.
    """

    family: ClassVar[str] = "shape"
    turned: ClassVar[bool] = False

    @abstractmethod
    def shapes(self, signal: FloatArray, size: Size) -> Iterable[tuple[str, FloatArray]]:
        """Yield for each function what it is in words, and its values for the signal, shape (R, L).

        ``size``: what the functions are relative to.
        """

    def signal(self, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return the signal that it is a function of, shape (R, L): the response's motion."""
        return group.motion

    def answer(self, group: WhitenedGroup, scale: Scale) -> ComplexArray | float:
        """Return the transfer from the functions to the response, shape (R, K) or (K,)."""
        return 1.0

    def gain(self, group: WhitenedGroup, scale: Scale) -> ComplexArray | float:
        """Return the transfer from noise of the response to that of the signal, (R, K) or (K,)."""
        return 1.0

    def _shapes_of_signal(
        self, group: WhitenedGroup, scale: Scale, offset: FloatArray | float = 0.0
    ) -> list[tuple[str, FloatArray]]:
        """Return the functions of the signal and an offset, each with its words.

        They have the scale of the signal itself.
        """
        signal = self.signal(group, scale)
        largest = np.max(np.abs(signal), axis=1, keepdims=True, initial=0.0)
        noise = self._deviation(group.input_share, group, scale)[:, None]
        return list(self.shapes(signal + offset, Size(scale, largest, noise)))

    def _deviation(self, share: FloatArray, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return the standard deviation in time that a share of the noise gives the signal, (R,).

        ``share``: part of the noise at each bin that is in the motion, shape (R, K).
        """
        power = share * group.noise_power * np.abs(self.gain(group, scale)) ** 2
        return np.asarray(np.sqrt(2.0 * np.sum(power, axis=1) / group.samples))

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield the functions by their bins."""
        for words, shape in self._shapes_of_signal(group, scale):
            yield words, self._columns_of_shape(shape, group, scale)

    def columns_of(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """Return one function by its bins."""
        _, shape = self._shapes_of_signal(group, scale)[candidate.number]
        return self._columns_of_shape(shape, group, scale)

    def _columns_of_shape(
        self, shape: FloatArray, group: WhitenedGroup, scale: Scale
    ) -> ComplexArray:
        """Return a function's columns by bins, with its quadrature where that is asked for."""
        columns = (group.bins_of(shape) * self.answer(group, scale))[:, None]
        return np.concatenate([columns, 1j * columns], axis=1) if self.turned else columns

    def doubt(self, candidate: Candidate, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return the products of a place's columns with an error of the reference's noise, (R, m).

        It is the mean of a column times the residual e = −η, where the motion holds η: −Σ E[f(y +
        η) η] |W|² of the bins, by the two nodes y ± σ of Gauss and Hermite's quadrature.
        """
        samples = group.samples
        gain = np.asarray(self.gain(group, scale), dtype=complex)
        doubt = group.errors.doubt
        answer = np.asarray(self.answer(group, scale), dtype=complex)
        sigma = self._deviation(doubt, group, scale)
        in_common = np.broadcast_to(np.real(answer * gain), doubt.shape)
        covariance = 2.0 / samples * np.sum(doubt * in_common, axis=1)
        shapes_at_nodes = [
            self._shapes_of_signal(group, scale, sign * sigma[:, None])[candidate.number][1]
            for sign in (1, -1)
        ]
        step = samples // group.motion.shape[1]
        slope = np.divide(-0.5 * covariance, sigma, out=np.zeros_like(sigma), where=sigma > 0.0)
        products = (
            slope
            * np.sum((shapes_at_nodes[0] - shapes_at_nodes[1]) * group.used[:, ::step], axis=1)
            * step
        )
        return np.stack([products, np.zeros_like(products)] if self.turned else [products], axis=1)


class OfReference(Shape):
    """A departure by functions without memory of the reference, which the sensor answers."""

    def signal(self, group: WhitenedGroup, scale: Scale) -> FloatArray:
        """Return the most likely motion at the sensor's input, shape (R, L)."""
        return group.reference

    def answer(self, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """Return the sensor's transfer function, shape (R, K)."""
        return group.transfer

    def gain(self, group: WhitenedGroup, scale: Scale) -> ComplexArray:
        """Return one over the sensor's transfer function, zero where that is, shape (R, K)."""
        return np.divide(
            1.0, group.transfer, out=np.zeros_like(group.transfer), where=group.transfer != 0.0
        )


def pooled(first: Sequence[Places], second: Sequence[Places]) -> list[Places]:
    """Return places whose amounts two groups share; none where one group has none."""
    if not first or not second:
        return []
    return [
        replace(first_places, sums=first_places.sums + second_places.sums)
        for first_places, second_places in zip(first, second, strict=True)
    ]

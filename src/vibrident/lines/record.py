"""A record's residual, and all that could change it, at the lines of its transform, for the end of training."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy import fft

from vibrident.lines.normal import horner
from vibrident.lines.runs import shifted_lines
from vibrident.lines.series import RunSeries
from vibrident.measure.lines import line_counts, waves
from vibrident.measure.response import ComplexArray
from vibrident.records import BoolArray, FloatArray

T = TypeVar("T")
#: Free responses of a record in pieces are not looked at beyond so many columns, or so many numbers: its samples keep
#: equal weights.
MOST_COLUMNS, LARGEST = 400, 1e8
#: Step of the central differences of the response.
STEP = 1e-5

#: What initial states and drift add at the lines, shape (m, lines); with True, their slopes over the record, too.
FreeLines = Callable[[bool], ComplexArray]


@dataclass(frozen=True, eq=False)
class RecordLines:
    """One record from the first to the last sample that counts, in units of the noise that it was weighted by.

    Whole samples only: zeros at the edges would be motion that no initial state explains, and leak over all lines.

    Attributes:
        residual: measured less network, shape (lines,).
        predicted: makes the network's response, shape (lines,).
        used: shape (n,).
        twice: how often a line counts in a sum over all, zero beyond the band that counts, shape (lines,).
        slopes: of the response with z, less what initial states could imitate, shape (p, lines).
        free: columns of what is unknown beside z; None where they are too many to be looked at.
        response: the model's, H, at the lines for given z; None without a reference.
        z: where the network was evaluated, shape (p,).
        floor: lower limit of the residual's variance.
        hum: places, in lines, of tones that no motion causes; they are taken out of residual and slopes.
        rings_unseen: whether the sensor's free motion is all above half the sampling rate: what a record shows at the
            aliases of it tells nothing.
    """

    residual: ComplexArray
    predicted: Callable[[], ComplexArray]
    used: BoolArray
    twice: FloatArray
    slopes: ComplexArray
    free: FreeLines | None
    response: Callable[[FloatArray], ComplexArray] | None
    z: FloatArray
    floor: float
    hum: tuple[float, ...] = ()
    rings_unseen: bool = False

    @property
    def samples(self) -> int:
        """Number of samples from first to last."""
        return int(self.used.shape[0])

    @property
    def count(self) -> float:
        """Number of samples that are used."""
        return float(self.used.sum())

    @property
    def through(self) -> ComplexArray | None:
        """H at z, shape (lines,)."""
        return None if self.response is None else self.response(self.z)

    def slope_of(self, of_response: Callable[[ComplexArray], T]) -> list[T]:
        """Slopes with each coordinate of what is linear in H, by central differences."""
        assert self.response is not None
        ends = np.eye(len(self.z)) * STEP
        return [of_response((self.response(self.z + e) - self.response(self.z - e)) / (2.0 * STEP)) for e in ends]

    def unknowns(self, *, edges: bool, tones: tuple[float, ...]) -> ComplexArray:
        """Lines of what is unknown beside the parameters, zero where they do not count, shape (m, lines).

        Args:
            edges: beside initial states, offset and drift of each run, the slopes of these.
            tones: places, in lines, of tones; each with its slope with frequency.
        """
        free = np.zeros((0, len(self.twice)), dtype=complex) if self.free is None else self.free(edges)
        found = np.concatenate([free, *(self._tone(place) for place in tones)]) if tones else free
        found[:, self.twice == 0.0] = 0.0
        return found

    def _tone(self, place: float) -> ComplexArray:
        return np.asarray(fft.rfft(waves([place], self.samples) * self.used, axis=1))

    def without_ringing(self) -> RecordLines:
        """The slopes less what slopes of the initial states could imitate.

        The states at the optimum hold noise, and their change with z would count as information.
        """
        columns, root = self.unknowns(edges=True, tones=self.hum), np.sqrt(self.twice)
        share, *_ = np.linalg.lstsq(*(((rows * root).view(float)).T for rows in (columns, self.slopes)), rcond=1e-9)
        return replace(self, slopes=self.slopes - share.T @ columns)

    def where_used(self, lines: ComplexArray) -> ComplexArray:
        """Lines of the signal of these lines, set to zero where the record is not used."""
        if self.used.all():
            return lines
        return np.asarray(fft.rfft(np.asarray(fft.irfft(lines, self.samples)) * self.used))


def free_of_run(samples: int, denominator: FloatArray) -> FreeLines:
    """What the n initial states and a drift of a whole run add: z w^k / a and z / w, shape (n + 1, lines).

    With their slopes over the record: z w^k / a² and z / w², which n more states and a curved drift would add.

    Args:
        samples: N.
        denominator: a, ascending in w = z − 1, shape (n + 1,).
    """
    order = len(denominator) - 1

    def lines(edges: bool) -> ComplexArray:
        w = shifted_lines(samples)
        over = 1.0 / horner(denominator, w)
        found = np.empty(((order + 1) * (2 if edges else 1), len(w)), dtype=complex)
        np.multiply(1.0 + w, over, out=found[0])
        for k in range(1, order):
            np.multiply(found[k - 1], w, out=found[k])
        found[order, 0] = 2.0  # line 0 does not count
        np.divide(1.0 + w[1:], w[1:], out=found[order, 1:])
        if edges:
            np.multiply(found[:order], over, out=found[order + 1 : -1])
            found[-1, 0] = 2.0
            np.divide(found[order, 1:], w[1:], out=found[-1, 1:])
        return found

    return lines


def free_of_pieces(samples: int, pieces: Sequence[tuple[slice, RunSeries]]) -> FreeLines | None:
    """The same of a record in pieces, or with samples left out, by transforms of signals in time.

    Args:
        samples: of the record, from first to last.
        pieces: place of each run, and its series.
    """
    count = sum(len(series.free) + 1 for _, series in pieces)
    if not pieces or count > MOST_COLUMNS or count * samples > LARGEST:
        return None

    def lines(edges: bool) -> ComplexArray:
        turn = np.arange(samples) / max(samples, 1)
        columns = []
        for place, series in pieces:
            ramp = np.linspace(-1.0, 1.0, place.stop - place.start) * series.free[-1]
            for row in (*series.free, ramp):
                placed = np.zeros(samples)
                placed[place] = row
                columns += [placed, turn * placed] if edges else [placed]
        return np.asarray(fft.rfft(np.array(columns), axis=1))

    return lines


@functools.lru_cache(maxsize=8)
def counted(samples: int, highest: float) -> FloatArray:
    """Weight of each line in a sum over all: zero above ``highest``, a part of the sampling rate; do not write to it.

    It is zero for line 0 too, which holds the offset.
    """
    twice = line_counts(samples)
    twice[:1] = 0.0
    twice[np.arange(len(twice)) > highest * samples] = 0.0
    twice.flags.writeable = False
    return twice

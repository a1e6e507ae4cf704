"""A record's residual, and all that could change it, at the bins of its transform, for the end of training."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.bins.normal import horner
from vibrident.fit.bins.segments import MOST_KEPT, shifted_lines, tone_bins
from vibrident.fit.bins.series import SegmentSeries
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import LEAST_DEVIATION, ComplexArray
from vibrident.fit.response.rounding import converter_step
from vibrident.fit.response.transform import in_blocks, line_counts, power_of, waves
from vibrident.physics.discretisation.inputs import USABLE_BAND

#: Free responses of a record in pieces are not looked at beyond so many columns, or so many numbers: its samples keep
#: equal weights.
MOST_COLUMNS, LARGEST = 400, 1e8
#: Largest part of a record that is left out for a length that transforms fast.
MAX_LOST = 0.01
#: Step of the central differences of the response.
STEP = 1e-5

#: LinesAt at some lines, shape (m, lines) or (lines,).
BinsAt = Callable[[slice], ComplexArray]
#: What initial states and drift add at the lines; with True, their slopes over the record, too.
FreeLines = Callable[[bool], BinsAt]


@dataclass(frozen=True, eq=False)
class ModelLines:
    """The model's response H at the lines of a grid, and its slopes.

    Attributes:
        at: H at the lines for given z.
        z: where the network was evaluated, shape (p,).
        lines: number of lines; of many, nothing is kept.
    """

    at: Callable[[FloatArray], ComplexArray]
    z: FloatArray
    lines: int

    def through(self) -> ComplexArray:
        """H at z, shape (lines,)."""
        return self._through if self.lines <= MOST_KEPT else self.at(self.z)

    def power(self) -> FloatArray:
        """|H|² at z, shape (lines,)."""
        return self._power if self.lines <= MOST_KEPT else power_of(self.at(self.z))

    def jacobian(self) -> Iterable[ComplexArray]:
        """∂H for each coordinate in turn, by central differences; each of shape (lines,)."""
        return self._slopes if self.lines <= MOST_KEPT else self._made()

    @functools.cached_property
    def _through(self) -> ComplexArray:
        return self.at(self.z)

    @functools.cached_property
    def _power(self) -> FloatArray:
        return power_of(self._through)

    @functools.cached_property
    def _slopes(self) -> tuple[ComplexArray, ...]:
        return tuple(self._made())

    def _made(self) -> Iterator[ComplexArray]:
        for end in np.eye(len(self.z)) * STEP:
            yield (self.at(self.z + end) - self.at(self.z - end)) / (2.0 * STEP)


@dataclass(frozen=True, eq=False)
class RecordBins:
    """One record from the first to the last sample that counts, in units of the noise that it was weighted by.

    Whole samples only: zeros at the edges would be motion that no initial state explains, and leak over all lines.

    Attributes:
        residual: measured less network, shape (lines,).
        predicted: the network's response at some lines, shape (lines,).
        used: shape (n,).
        one_sided: how often a line counts in a sum over all, zero beyond the band that counts, shape (lines,).
        slopes: of the response with z, less what initial states could imitate, shape (p, lines).
        free: columns of what is unknown beside z; None where they are too many to be looked at.
        model: its response at the lines, which records of one grid share; None without a reference.
        z: where the network was evaluated, shape (p,).
        floor: lower limit of the residual's variance.
        hum: places, in lines, of tones that no motion causes; they are taken out of residual and slopes.
        rings_unseen: whether the sensor's free motion is all above half the sampling rate: what a record shows at the
            aliases of it tells nothing.
        colour: power of the reference's own noise over its mean, one or shape (lines,).
        last: bins from here on are not looked at; zero: those above 0.4 of the sampling rate.
    """

    residual: ComplexArray
    predicted: BinsAt
    used: BoolArray
    one_sided: FloatArray
    jacobian: ComplexArray
    free: FreeLines | None
    model: ModelLines | None
    z: FloatArray
    floor: float
    hum: tuple[float, ...] = ()
    rings_unseen: bool = False
    colour: FloatArray | float = 1.0
    last: int = 0

    @property
    def samples(self) -> int:
        """Number of samples from first to last."""
        return int(self.used.shape[0])

    @property
    def count(self) -> float:
        """Number of samples that are used."""
        return float(self.used.sum())

    def nuisances(self, *, edges: bool, tones: tuple[float, ...]) -> BinsAt:
        """Lines of what is unknown beside the parameters, zero where they do not count.

        Of a long record those asked for are made each time: all together need much memory.

        Args:
            edges: beside initial states, offset and drift of each run, the slopes of these.
            tones: places, in lines, of tones; each with its slope with frequency.
        """
        columns = [] if self.free is None else [self.free(edges)]
        if tones and self.samples:  # of a record without usable runs nothing is left
            columns.append(self._tones(tones))

        def some(part: slice) -> ComplexArray:
            one_sided = self.one_sided[part]
            found = np.concatenate([np.zeros((0, len(one_sided)), dtype=complex), *(made(part) for made in columns)])
            found[:, one_sided == 0.0] = 0.0
            return found

        return some if self.samples > MOST_KEPT else _made(some(slice(None)))

    def _tones(self, places: tuple[float, ...]) -> BinsAt:
        if self.used.all():
            return functools.partial(tone_bins, places, self.samples)
        return _made(np.asarray(fft.rfft(waves(places, self.samples) * self.used, axis=1)))

    def without_ringing(self) -> RecordBins:
        """The slopes less what slopes of the initial states could imitate.

        The states at the optimum hold noise, and their change with z would count as information.
        """
        columns, root = self.nuisances(edges=True, tones=self.hum)(slice(None)), np.sqrt(self.one_sided)
        share, *_ = np.linalg.lstsq(*(((rows * root).view(float)).T for rows in (columns, self.jacobian)), rcond=1e-9)
        return replace(self, jacobian=self.jacobian - share.T @ columns)

    def beside_drift(self) -> RecordBins:
        """The record with its residual, changed in place, less a straight drift: that leaks into all bins as noise."""
        if self.free is None:
            return self
        columns, root = self.nuisances(edges=False, tones=self.hum), np.sqrt(self.one_sided)
        blocks, sums = in_blocks(self.residual.size), 0.0
        for part in blocks:
            rows = (np.concatenate([columns(part), self.residual[None, part]]) * root[part]).view(float)
            sums = sums + rows @ rows.T
        gram = np.asarray(sums)
        amounts = inverse_where_shown(gram[:-1, :-1]) @ gram[:-1, -1]
        for part in blocks:
            self.residual[part] -= amounts @ columns(part)
        without_offset(self.residual)
        return self

    def where_used(self, lines: ComplexArray) -> ComplexArray:
        """Lines of the signal of these lines, set to zero where the record is not used."""
        if self.used.all():
            return lines
        return np.asarray(fft.rfft(np.asarray(fft.irfft(lines, self.samples)) * self.used))


def bins_of_series(record: Record, predicted: FloatArray, unit: float, parameters: int) -> RecordBins:
    """Bins of a record from its predicted response, NaN where it is not defined, beside offset, drift and known hum.

    For a network that runs in time: slopes, zero of so many ``parameters``, and response in frequency are not known.
    ``unit``: in which the bins are, response unit.
    """
    used = record.mask & np.isfinite(predicted)
    span = span_of(used)
    span = slice(span.start, span.start + fast_below(span.stop - span.start, MAX_LOST)) if used.any() else span
    used = used[span]
    measured, modelled = (np.where(used, series[span], 0.0) for series in (record.response, predicted))
    straight = np.stack([used, used * np.linspace(-1.0, 1.0, used.size)])
    lines = np.fft.rfft(np.concatenate([[measured - modelled, modelled], straight, np.arange(used.size) * straight]))
    lines[:2] /= unit
    step = converter_step(record.response, record.mask) / np.sqrt(12.0)
    return RecordBins(
        lines[0],
        lines[1].__getitem__,
        used,
        counted(used.size, USABLE_BAND),
        np.zeros((parameters, lines.shape[1]), dtype=complex),
        lambda edges: _made(lines[2:] if edges else lines[2:4]),
        None,
        np.zeros(parameters),
        (max(LEAST_DEVIATION * float(np.std(measured)), step, np.finfo(float).tiny) / unit) ** 2,
        tuple(hz * used.size / record.sampling_rate_hz for hz in record.hum_hz),
    ).beside_drift()


def without_offset(residual: ComplexArray) -> None:
    """Set bin 0, in place, to the size of the next: an offset is no noise."""
    residual[:1] = np.abs(residual[1:2])


def free_of_run(samples: int, denominator: FloatArray) -> FreeLines:
    """What the n initial states and a drift of a whole run add: z w^k / a and z / w, n + 1 columns.

    With their slopes over the record: z w^k / a² and z / w², which n more states and a curved drift would add.

    Args:
        samples: N.
        denominator: a, ascending in w = z − 1, shape (n + 1,).
    """
    order = len(denominator) - 1

    def lines(edges: bool, part: slice) -> ComplexArray:
        w = shifted_lines(samples, part)
        over = 1.0 / horner(denominator, w)
        found = np.empty(((order + 1) * (2 if edges else 1), len(w)), dtype=complex)
        np.multiply(1.0 + w, over, out=found[0])
        for k in range(1, order):
            np.multiply(found[k - 1], w, out=found[k])
        w = np.where(w == 0.0, 1.0, w)  # line 0 does not count
        np.divide(1.0 + w, w, out=found[order])
        if edges:
            np.multiply(found[:order], over, out=found[order + 1 : -1])
            np.divide(found[order], w, out=found[-1])
        return found

    if samples > MOST_KEPT:
        return lambda edges: functools.partial(lines, edges)
    kept = functools.cache(functools.partial(lines, part=slice(None)))
    return lambda edges: _made(kept(edges))


def _made(columns: ComplexArray) -> BinsAt:
    return lambda part: columns[:, part]


def free_of_pieces(samples: int, pieces: Sequence[tuple[slice, SegmentSeries]]) -> FreeLines | None:
    """The same of a record in pieces, or with samples left out, by transforms of signals in time.

    Args:
        samples: of the record, from first to last.
        pieces: place of each run, and its series.
    """
    count = sum(len(series.free) + 1 for _, series in pieces)
    if not pieces or count > MOST_COLUMNS or count * samples > LARGEST:
        return None

    def lines(edges: bool) -> BinsAt:
        turn = np.arange(samples) / max(samples, 1)
        columns = []
        for place, series in pieces:
            ramp = np.linspace(-1.0, 1.0, place.stop - place.start) * series.free[-1]
            for row in (*series.free, ramp):
                placed = np.zeros(samples)
                placed[place] = row
                columns += [placed, turn * placed] if edges else [placed]
        return _made(np.asarray(fft.rfft(np.array(columns), axis=1)))

    return lines


def counted(samples: int, highest: float) -> FloatArray:
    """Weight of each line in a sum over all: zero above ``highest``, a part of the sampling rate; do not write to it.

    It is zero for line 0 too, which holds the offset.
    """
    return (_counted_kept if samples <= MOST_KEPT else _counted)(samples, highest)


def _counted(samples: int, highest: float) -> FloatArray:
    one_sided = line_counts(samples)
    one_sided[:1] = 0.0
    one_sided[int(highest * samples) + 1 :] = 0.0
    one_sided.flags.writeable = False
    return one_sided


_counted_kept = functools.lru_cache(maxsize=8)(_counted)

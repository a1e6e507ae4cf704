"""Records at their bins, in the noise of their residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.descent.settle import InNoise
from vibrident.fit.group.network import Nuisances
from vibrident.fit.noise.spectrum import NoiseSpectrum, PredictedMotion, noise_spectra
from vibrident.fit.noise.tones import harmonic_bins, with_tones
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.network_problem import noise_floor_of
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import (
    counts_in_band,
    line_frequencies,
    power_of,
    reference_colour,
    waves,
)

#: Largest fraction of a record that is left out for a length that transforms fast.
MAX_LOST = 0.01
#: Fewest samples of a record that is used.
MIN_SAMPLES = 8

#: Response of a sensor to its reference by frequency in Hz, both of shape (n,).
Transfer = Callable[[FloatArray], ComplexArray]


@dataclass(frozen=True, eq=False)
class WeightedBins:
    """Record, or an unbroken segment of one, in the noise of its residual.

    Attributes:
        record: its index.
        span: its samples, N in number.
        used: which of them count, shape (N,).
        residual: measured less predicted response, with known nuisances fitted, shape (K,).
        predicted: the response to the reference, shape (K,).
        nuisances: columns in addition to those of the parameters, shape (m, K).
        counts: how often each bin counts in a sum over all, shape (K,).
        spectrum: of the noise.
        passed: |H|², shape (K,); None where it is not known.
    """

    record: int
    span: slice
    used: BoolArray
    residual: ComplexArray
    predicted: ComplexArray
    nuisances: ComplexArray
    counts: FloatArray
    spectrum: NoiseSpectrum
    passed: FloatArray | None = None

    @property
    def samples(self) -> int:
        """Return the number of samples."""
        return int(self.used.size)

    @property
    def count(self) -> float:
        """Return the number of samples that are used."""
        return float(self.used.sum())

    @property
    def passed_noise(self) -> FloatArray:
        """Return the noise of the reference behind the sensor at each bin, shape (K,)."""
        if self.passed is None:
            return np.zeros(self.residual.size)
        return self.spectrum.input_noise_at * self.passed


def weighted_segments(
    in_noise: InNoise, z: FloatArray, coordinates: Coordinates, *, fitted_everywhere: bool = False
) -> Iterator[WeightedBins]:
    """Yield the driven segments of a fit at its estimate, in its noise; no free decays.

    ``fitted_everywhere``: whether the nuisances are those that fit all bins best; the fit's follow
    from the bins that show motion, and may be of any size in the others.
    """
    segments = in_noise.band.problem.segments
    for place in in_noise.places(z, coordinates):
        grid = place.group.grid
        used = place.group.used
        fitted = place.fitted_in_all_bins if fitted_everywhere else place.rows
        for row, number in enumerate(place.group.segments if grid.driven else ()):
            yield WeightedBins(
                segments[number].record,
                segments[number].span,
                np.broadcast_to(True, grid.samples) if used is None else used[row],
                fitted.residual[row],
                fitted.predicted[row],
                place.rows.nuisances.of_row(row),
                grid.counts * grid.samples,
                in_noise.weighting.of_segment(number).spectrum_at(grid),
                power_of(place.through),
            )


@dataclass(frozen=True, eq=False)
class PredictedRecord:
    """A record and its predicted response, of which nothing else is known.

    Attributes:
        number: index of the record.
        record: the record.
        predicted: its response, shape (samples,), NaN where not defined.
        turns: of a sine in a sample, whose harmonics are no hum; None: not asked for.
        transfer: response to the reference by frequency in Hz, with which its noise arrives; None:
            not known.
        most_bins: number of bins that are looked at, from frequency zero on; None: all.
    """

    number: int
    record: Record
    predicted: FloatArray
    turns: float | None = None
    transfer: Transfer | None = None
    most_bins: int | None = None

    def at_bins(self) -> _Unread | None:
        """Return the record by its bins, or None of too few samples.

        Offset, drift and hum are fitted; nothing else is known of a network that runs in time.
        """
        record = self.record
        used = record.mask & np.isfinite(self.predicted)
        if used.sum() < MIN_SAMPLES:
            return None
        span = span_of(used)
        span = slice(span.start, span.start + fast_below(span.stop - span.start, MAX_LOST))
        used = used[span]
        n = used.size
        measured, modelled = (
            np.where(used, series[span], 0.0) for series in (record.response, self.predicted)
        )
        band = slice(self.most_bins)
        counts = counts_in_band(n)[band]
        residual, motion, *columns = fft.rfft(
            [measured - modelled, modelled, used * 1.0, used * np.linspace(-1.0, 1.0, n)]
        )[:, band]
        colour = reference_colour(record, n)
        colour = colour[band] if isinstance(colour, np.ndarray) else colour
        through = None
        if self.transfer is not None:
            hz = line_frequencies(n, record.sampling_rate_hz)[band]
            through = colour * power_of(self.transfer(hz))
        prediction = PredictedMotion(
            motion,
            float(used.sum()),
            int(np.flatnonzero(counts)[-1]),
            through,
            colour,
            lines=None if self.turns is None else harmonic_bins(n, self.turns, counts.size),
        )
        unread = _Unread(self, span, used, residual, prediction, np.array(columns), counts)
        return unread.freed_of_tones(
            tuple(hz * n / record.sampling_rate_hz for hz in record.hum_hz)
        )


@dataclass(frozen=True, eq=False)
class _Unread:
    """A predicted record at its bins, of which the noise is not read yet.

    Attributes:
        source: the record and its prediction.
        span: its samples, N in number.
        used: which of them count, shape (N,).
        residual: measured less predicted response, shape (K,).
        motion: as the reading of the noise sees it.
        nuisances: columns, shape (m, K).
        counts: how often each bin counts in a sum over all, shape (K,).
    """

    source: PredictedRecord
    span: slice
    used: BoolArray
    residual: ComplexArray
    motion: PredictedMotion
    nuisances: ComplexArray
    counts: FloatArray

    @property
    def alike(self) -> tuple[float | bool, ...]:
        """Return what records have in common whose noise is read together."""
        record = self.source.record
        counts = self.used.size, self.counts.size, record.reference_noise_order
        return record.sampling_rate_hz, *counts, self.source.turns is None

    def freed_of_tones(self, tones: tuple[float, ...], psd: FloatArray | float = 1.0) -> _Unread:
        """Return the record with tones, by place in bins, among its nuisances, and free of them.

        ``psd``: noise at each bin that the nuisances are fitted in, shape (K,).
        """
        band = slice(self.counts.size)
        waves_at_bins = fft.rfft(waves(tones, self.used.size) * self.used)[:, band]
        nuisances = np.concatenate([self.nuisances, waves_at_bins])
        residual = freed(self.residual, nuisances, self.counts / psd)
        return replace(self, residual=residual, nuisances=nuisances)

    def in_noise(self, spectrum: NoiseSpectrum) -> WeightedBins:
        """Return the record in a noise."""
        return WeightedBins(
            self.source.number,
            self.span,
            self.used,
            self.residual,
            self.motion.predicted,
            self.nuisances,
            self.counts,
            spectrum,
        )


def weighted_records(records: Sequence[PredictedRecord]) -> list[WeightedBins]:
    """Return records by their predicted responses, without those of too few samples.

    The noise of those of one length and rate, which have one transfer, is read at once.
    """
    unread = [bins for bins in (record.at_bins() for record in records) if bins is not None]
    numbers_by_kind = dict[tuple[float | bool, ...], list[int]]()
    for number, bins in enumerate(unread):
        numbers_by_kind.setdefault(bins.alike, []).append(number)
    weighted = dict[int, WeightedBins]()
    for numbers in numbers_by_kind.values():
        alike = [unread[number] for number in numbers]
        weighted |= zip(numbers, _in_noise(alike), strict=True)
    return [weighted[number] for number in range(len(unread))]


def _in_noise(alike: Sequence[_Unread]) -> list[WeightedBins]:
    """Return records of one length and rate in their noise, read again where hum leaks."""
    weighted = list[WeightedBins]()
    for bins, spectrum in zip(alike, _spectra(alike), strict=True):
        if not spectrum.tones:
            weighted.append(bins.in_noise(spectrum))
            continue
        without_hum = bins.freed_of_tones(spectrum.tones, spectrum.psd)
        (second,) = _spectra([without_hum])
        tones = with_tones(spectrum.tones, second.tones)
        second = replace(second, tones=tones, excess=spectrum.excess)
        weighted.append(replace(without_hum, residual=bins.residual).in_noise(second))
    return weighted


def _spectra(alike: Sequence[_Unread]) -> list[NoiseSpectrum]:
    """Return the noise of the residuals of records of one length and rate."""
    residuals = np.stack([bins.residual for bins in alike])
    floors = [noise_floor_of(bins.source.record) ** 2 for bins in alike]
    return noise_spectra(residuals, [bins.motion for bins in alike], floors)


def freed(row: ComplexArray, columns: ComplexArray, weight: FloatArray) -> ComplexArray:
    """Return a row, shape (K,), less the columns that fit it best in a weight.

    Args:
        row: shape (K,).
        columns: shape (m, K).
        weight: shape (K,).
    """
    return row - Nuisances.in_weight(columns[None], weight[None]).imitated(row[None, None])[0, 0]

"""Records at their bins, in the noise of their residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.descent.settle import InNoise
from vibrident.fit.group.network import Nuisances
from vibrident.fit.noise.spectrum import NoiseSpectrum, PredictedMotion, noise_spectrum
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


def weighted_series(
    number: int,
    record: Record,
    predicted: FloatArray,
    turns: float | None = None,
    transfer: Transfer | None = None,
) -> WeightedBins | None:
    """Return a record by its predicted response, or None of too few samples.

    Offset, drift and hum are fitted; nothing else is known of a network that runs in time.

    Args:
        number: index of the record.
        record: the record.
        predicted: its response, shape (samples,), NaN where not defined.
        turns: of a sine in a sample, whose harmonics are no hum; None: not asked for.
        transfer: response to the reference by frequency in Hz, with which its noise arrives; None:
            not known.
    """
    used = record.mask & np.isfinite(predicted)
    if used.sum() < MIN_SAMPLES:
        return None
    span = span_of(used)
    span = slice(span.start, span.start + fast_below(span.stop - span.start, MAX_LOST))
    used = used[span]
    n = used.size
    measured, modelled = (
        np.where(used, series[span], 0.0) for series in (record.response, predicted)
    )
    counts = counts_in_band(n)
    residual, motion, *columns = fft.rfft(
        [measured - modelled, modelled, used * 1.0, used * np.linspace(-1.0, 1.0, n)]
    )
    colour = reference_colour(record, n)
    through = None
    if transfer is not None:
        through = colour * power_of(transfer(line_frequencies(n, record.sampling_rate_hz)))
    prediction = PredictedMotion(
        motion,
        float(used.sum()),
        int(np.flatnonzero(counts)[-1]),
        through,
        colour,
        lines=None if turns is None else harmonic_bins(n, turns, counts.size),
    )
    floor = noise_floor_of(record) ** 2
    hum = tuple(hz * n / record.sampling_rate_hz for hz in record.hum_hz)
    nuisances = np.concatenate([columns, fft.rfft(waves(hum, n) * used)])
    residual = freed(residual, nuisances, counts)
    spectrum = noise_spectrum(residual, prediction, floor)
    if spectrum.tones:  # leakage of hum is no noise
        first = spectrum
        nuisances = np.concatenate([nuisances, fft.rfft(waves(first.tones, n) * used)])
        spectrum = noise_spectrum(freed(residual, nuisances, counts / first.psd), prediction, floor)
        tones = with_tones(first.tones, spectrum.tones)
        spectrum = replace(spectrum, tones=tones, excess=first.excess)
    return WeightedBins(number, span, used, residual, motion, nuisances, counts, spectrum)


def freed(row: ComplexArray, columns: ComplexArray, weight: FloatArray) -> ComplexArray:
    """Return a row, shape (K,), less the columns that fit it best in a weight.

    Args:
        row: shape (K,).
        columns: shape (m, K).
        weight: shape (K,).
    """
    return row - Nuisances.in_weight(columns[None], weight[None]).imitated(row[None, None])[0, 0]

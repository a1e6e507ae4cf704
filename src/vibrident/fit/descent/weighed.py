"""Records at their bins, in the noise that their residuals show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.descent.settle import InNoise
from vibrident.fit.group.network import Nuisances
from vibrident.fit.noise.spectrum import Motion, NoiseSpectrum, noise_spectrum
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.network_problem import noise_floor_of
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import counts_in_band, power_of, waves

#: Largest part of a record that is left out for a length that transforms fast.
MAX_LOST = 0.01
#: Fewest samples of which anything is said.
MIN_SAMPLES = 8


@dataclass(frozen=True, eq=False)
class Weighed:
    """A record, or an unbroken segment of one, in the noise that its residual shows.

    Attributes:
        record: its number.
        span: its samples, N in number.
        used: which of them count, shape (N,).
        residual: measured less predicted response, beside known nuisances, shape (K,).
        predicted: the response to the reference, shape (K,).
        nuisances: columns beside the parameters', shape (m, K).
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


def weighed_segments(
    in_noise: InNoise, z: FloatArray, coordinates: Coordinates
) -> Iterator[Weighed]:
    """Yield the segments of a fit at its estimate, in its noise; free decays are none."""
    segments = in_noise.band.problem.segments
    for place in in_noise.places(z, coordinates):
        grid = place.group.grid
        used = place.group.used
        for row, number in enumerate(place.group.segments if grid.driven else ()):
            yield Weighed(
                segments[number].record,
                segments[number].span,
                np.broadcast_to(True, grid.samples) if used is None else used[row],
                place.rows.residual[row],
                place.rows.predicted[row],
                place.rows.nuisances.columns[row],
                grid.counts * grid.samples,
                in_noise.weighting.spectra[number],
                power_of(place.through),
            )


def weighed_series(number: int, record: Record, predicted: FloatArray) -> Weighed | None:
    """Return a record by its predicted response, NaN where not defined; None of too few samples.

    Beside an offset, a drift and hum; of a network that runs in time nothing else is known.
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
    seen = Motion(motion, float(used.sum()), int(np.flatnonzero(counts)[-1]))
    floor = noise_floor_of(record) ** 2
    known = tuple(hz * n / record.sampling_rate_hz for hz in record.hum_hz)
    nuisances = np.concatenate([columns, fft.rfft(waves(known, n) * used)])
    residual = freed(residual, nuisances, counts)
    spectrum = noise_spectrum(residual, seen, floor)
    if spectrum.tones:  # what hum leaks is no noise
        nuisances = np.concatenate([nuisances, fft.rfft(waves(spectrum.tones, n) * used)])
        spectrum = noise_spectrum(freed(residual, nuisances, counts / spectrum.psd), seen, floor)
    return Weighed(number, span, used, residual, motion, nuisances, counts, spectrum)


def freed(row: ComplexArray, columns: ComplexArray, weight: FloatArray) -> ComplexArray:
    """Return a row less the columns that fit it best in a weight; (K,), (m, K) and (K,) to (K,)."""
    return row - Nuisances.in_weight(columns[None], weight[None]).imitated(row[None, None])[0, 0]

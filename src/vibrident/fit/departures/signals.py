"""Residual, motion and slopes of a record at the estimate, by their bins, and their noise."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.descent.weighted_bins import freed
from vibrident.fit.noise.incoherent import HEARD_RATIO
from vibrident.fit.noise.leakage import beside_leakage
from vibrident.fit.noise.spectrum import NoiseSpectrum, PredictedMotion, noise_spectrum
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.tones import HARMONICS
from vibrident.fit.response.transform import power_of

#: The band over the highest frequency of the motion.
BAND_OVER_HIGHEST = 1.5
#: Information, in squares of the noise, beyond the motion's highest frequency: single noisy bins.
MIN_INFORMATION_BEYOND = 100.0
#: Fewest bins of a band, if there are so many: they determine the noise and its slow changes.
MIN_BINS = 512
#: Records whose bands differ by less than this factor are worked on side by side.
MAX_BAND_RATIO = 4.0
#: So many samples are worked on at once.
MAX_SAMPLES_AT_ONCE = 1 << 18


@dataclass(frozen=True, eq=False)
class Part:
    """A record, or a piece of it, of which the noise is not read yet.

    Attributes:
        record: the record.
        span: its samples, n in number.
        used: samples that count, shape (n,).
        residual: of the fit, shape (K,).
        predicted: response to the reference that recurs with the record, shape (K,).
        series: response as the fit has it, its free motion included, shape (n,).
        jacobian: of the response with the coordinates, shape (p, K).
        nuisance: columns of the nuisance parameters, shape (m, K).
        pull: shift of the fit's coordinates by those of the record, shape (P, p); None: the same.
        turns: of the record's sine from sample to sample; None for other motion.
        known_noise: at the bins, where the fit read it of the same residual; else None.
        is_band_limited: whether the fit supposes a band-limited reference between the samples.
    """

    record: Record
    span: slice
    used: BoolArray
    residual: ComplexArray
    predicted: ComplexArray
    series: FloatArray
    jacobian: ComplexArray
    nuisance: ComplexArray
    pull: FloatArray | None = None
    turns: float | None = None
    known_noise: NoiseSpectrum | None = None
    is_band_limited: bool = True

    @property
    def columns_beside_noise(self) -> ComplexArray:
        """Return the columns that are no noise, shape (q, K)."""
        if self.pull is None:
            return self.nuisance
        return np.concatenate([self.nuisance, self.jacobian])  # a misfit of the tone is no noise

    @property
    def floor(self) -> float:
        """Return the lower limit of the noise."""
        largest = float(np.max(np.abs(self.record.response[self.span])))
        return (np.finfo(float).eps * largest) ** 2

    @property
    def alike(self) -> tuple[float, ...]:
        """Return what parts have in common whose noise is read together."""
        counts = (
            self.used.size,
            self.residual.size,
            len(self.columns_beside_noise),
            self.record.reference_noise_order,
        )
        kinds = self.pull is None, self.turns is None, self.known_noise is None
        return self.record.sampling_rate_hz, *counts, *kinds


@dataclass(frozen=True, eq=False, kw_only=True)
class Signals(Part):
    """A part in its noise.

    Its slopes are those at the most likely motion, and tones of hum are among its nuisances.

    Attributes:
        transfer: of the sensor, shape (K,).
        spectrum: of the noise; that of the reference, over |H|².
        one_sided: how often a bin counts, shape (K,).
        motion: as the reading of the noise sees it.
    """

    transfer: ComplexArray
    spectrum: NoiseSpectrum
    one_sided: FloatArray
    motion: PredictedMotion

    @property
    def counted(self) -> BoolArray:
        """Return which bins count, shape (K,)."""
        return np.asarray(self.one_sided > 0.0)

    @property
    def level(self) -> FloatArray:
        """Return the power of the noise, a sample, at the bins, shape (K,)."""
        return self.spectrum.psd

    def in_noise_beside(self, columns: ComplexArray) -> Signals:
        """Return the signals in the noise beside columns of departures, shape (m, K).

        The columns are at the first bins. A departure that is no motion's is noise to the spectrum
        that was read before it was known.
        """
        if not columns.any():
            return self
        departing = np.zeros((len(columns), self.residual.size), dtype=complex)
        departing[:, 1 : columns.shape[1] + 1] = columns
        nuisances = np.concatenate([self.nuisance, departing, self.jacobian])
        noise = freed(self.residual, nuisances, self.one_sided / self.level)
        spectrum = replace(
            noise_spectrum(noise, self.motion, self.floor), tones=self.spectrum.tones
        )
        if self.pull is not None:
            spectrum = replace(spectrum, psd=beside_leakage(spectrum.psd, self.motion.lines))
        return replace(self, spectrum=spectrum)

    @functools.cached_property
    def last_bin(self) -> int:
        """Return the last bin of the band.

        The band ends at one and a half times the highest frequency of the motion, and holds a
        tone's harmonics.
        """
        power = np.divide(power_of(self.predicted), self.level * max(float(self.used.sum()), 1.0))
        power[(power < HEARD_RATIO) | ~self.counted] = 0.0
        information_beyond = np.cumsum(power[::-1])[::-1]
        band_end = BAND_OVER_HIGHEST * float(
            np.searchsorted(-information_beyond, -MIN_INFORMATION_BEYOND)
        )
        if self.turns is not None:
            band_end = max(band_end, (HARMONICS + 0.5) * self.turns * self.used.size)
        last_counted = int(np.flatnonzero(self.counted)[-1]) if self.counted.any() else 1
        return min(max(int(band_end) + 1, MIN_BINS), last_counted)


def grouped(signals: Sequence[Signals]) -> list[tuple[int, ...]]:
    """Return the numbers of records of one length, rate and like band, in limited groups."""
    numbers_by_kind = dict[tuple[int, int, float, bool, bool, int], list[int]]()
    for number, record_signals in enumerate(signals):
        band = round(np.log(record_signals.last_bin) / np.log(MAX_BAND_RATIO))
        key = (
            record_signals.used.size,
            record_signals.residual.size,
            record_signals.record.sampling_rate_hz,
            record_signals.turns is None,
            record_signals.pull is None,
            band,
        )
        numbers_by_kind.setdefault(key, []).append(number)
    groups = list[tuple[int, ...]]()
    for (samples, *_), numbers in numbers_by_kind.items():
        width = max(MAX_SAMPLES_AT_ONCE // samples, 1)
        groups += [tuple(numbers[first : first + width]) for first in range(0, len(numbers), width)]
    return groups


def most_likely(
    predicted: ComplexArray, residual: ComplexArray, share: FloatArray, noise: FloatArray
) -> ComplexArray:
    """Return the response to the most likely motion, shape (…, bins).

    X̂ = X + σx² H* R/S: its error is independent of the residual R, as that of the reference X is
    not. It is zero where noise may be all of it.

    Args:
        predicted: response to the reference.
        residual: of the fit, less nuisance parameters.
        share: part of the noise that is the reference's, σx² |H|²/S.
        noise: power S of the noise in a bin.
    """
    share = np.minimum(share, 1.0)
    likely = predicted + share * residual
    error_power = np.where(share > 0.0, share * (1.0 - share), 1.0) * noise
    return np.asarray(likely * (power_of(likely) > HEARD_RATIO * error_power))

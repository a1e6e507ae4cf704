"""A record's signals at the estimate, by their bins, and the part that the score tests look at."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.bins import without_offset
from vibrident.fit.departures.part import ROUNDING, Part, harmonics_of, orthonormal, without
from vibrident.fit.information import inverse_normal
from vibrident.fit.noise.incoherent import HEARD
from vibrident.fit.noise.motion import Motion
from vibrident.fit.noise.profile import slow_profile
from vibrident.fit.noise.spectrum import DOUBT, NoiseSpectrum, noise_spectrum
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of
from vibrident.fit.uncertainty.steps import rounding_in_residual


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of a record, or a piece of it, by the bins of their transforms.

    Attributes:
        record: the record.
        span: its samples, n in number.
        used: those that count, shape (n,).
        rest: residual, shape (bins,).
        predicted: response to the reference that recurs with the record, shape (bins,).
        series: response as the fit has it, its free motion included, shape (n,).
        jacobian: of the response with the coordinates, shape (p, bins).
        transfer: of the sensor, shape (bins,).
        nuisance: columns of the nuisance parameters, shape (q, bins).
        spectrum: of the noise, in the square of ``unit``; that of the reference, over |H|².
        unit: standard deviation that the record was weighted by.
        one_sided: how often a bin counts, shape (bins,).
        pull: as of :class:`Part`.
        turns: as of :class:`Part`.
        seen: motion, as the analysis of the noise sees it; None of too few bins for that.
        floor: lower limit of the noise, in the square of ``unit``.
        departing: columns of departures that are known, shape (m, bins); None of none.
    """

    record: Record
    span: slice
    used: BoolArray
    rest: ComplexArray
    predicted: ComplexArray
    series: FloatArray
    jacobian: ComplexArray
    transfer: ComplexArray
    nuisance: ComplexArray
    spectrum: NoiseSpectrum
    unit: float
    one_sided: FloatArray
    pull: FloatArray | None = None
    turns: float | None = None
    seen: Motion | None = None
    floor: float = 0.0
    departing: ComplexArray | None = None

    def in_noise_beside(self, columns: ComplexArray) -> Signals:
        """In the noise as it is beside the columns of departures, shape (m, bins).

        A departure that is no motion's is noise to the spectrum that was read before it was known.
        """
        known, spectrum = np.concatenate([self.nuisance, columns]), self.spectrum
        if self.seen is not None:
            freed = projected(self.rest / self.unit, np.concatenate([known, self.jacobian]), self.root)
            without_offset(freed)
            spectrum = replace(noise_spectrum(freed, self.seen, self.floor), tones=self.spectrum.tones)
        return replace(self, departing=columns, spectrum=spectrum)

    @property
    def counted(self) -> BoolArray:
        """Bins that count, shape (bins,)."""
        return np.asarray(self.one_sided > 0.0)

    @property
    def root(self) -> FloatArray:
        """Weight of the bins in a sum of squares, as a root, shape (bins,)."""
        return np.asarray(np.sqrt(self.one_sided / np.asarray(self.spectrum.psd)))

    @functools.cached_property
    def level(self) -> FloatArray:
        """Power of the noise, a sample, at the bins, shape (bins,)."""
        return np.asarray(np.asarray(self.spectrum.psd) * self.unit**2, dtype=float)

    @functools.cached_property
    def likely(self) -> ComplexArray:
        """Response to the most likely motion, zero where noise may be all of it, shape (bins,)."""
        predicted, left = (np.asarray(bins / self.unit, dtype=complex) for bins in (self.predicted, self.rest))
        predicted[0] = 0.0
        known = self.nuisance if self.departing is None else np.concatenate([self.nuisance, self.departing])
        rest = projected(left, known, self.root)
        return most_likely(predicted, rest, self.transfer, self.spectrum, self.used) * self.counted * self.unit

    @property
    def motion(self) -> FloatArray:
        """Response to the most likely motion in time, with the fit's free motion, shape (n,).

        A response that recurs with the record rings at its ends, where it jumps; what a departure makes of that ringing
        is no nuisance parameter's.
        """
        free = np.where(self.used, self.series - fft.irfft(self.predicted, self.used.size), 0.0)
        free = np.where(self.used, free - np.mean(free[self.used]) if self.used.any() else 0.0, 0.0)
        return np.asarray(fft.irfft(self.likely, self.used.size) + free)

    def part(self, effects: ComplexArray) -> Part:
        """The record whitened; ``effects``: relative change of the response by one u of each, shape (K, bins)."""
        n, counted, likely, pull = self.used.size, self.counted, self.likely, self.pull
        whitening = np.where(counted, 1.0 / np.sqrt(self.level), 0.0)
        basis = orthonormal(np.asarray(fft.irfft(self.nuisance * whitening, n, axis=-1)))

        def white(columns: ComplexArray) -> FloatArray:
            signals = np.asarray(fft.irfft(columns * whitening, n, axis=-1))
            return signals - (signals @ basis.T) @ basis

        # the tone of a sine is told from its points
        jacobian = self.jacobian * (power_of(likely) > 0.0) if pull is None else self.jacobian
        residual, whitened = white(self.rest), white(jacobian)
        beside = residual
        if pull is not None:
            harmonics = harmonics_of(self.turns or 0.0, n).reshape(-1, n) * self.used  # as the fit of the tone has them
            whitened = without(whitened, orthonormal(white(np.asarray(fft.rfft(harmonics, axis=1), dtype=complex))))
            beside = residual - (residual @ whitened.T) @ inverse_normal(whitened @ whitened.T) @ whitened
        transfer = np.where(counted, self.transfer, 0.0)
        doubt = self._doubt(transfer)
        # An error ε of σx² leaves ε H* R/S of the residual R in the most likely motion: a departure D = L Ŷ then has
        # Σ L* ε |R|²/S with it, as much as with the signal ε |R|²/(S Ŷ*).
        among = np.divide(doubt * power_of(self.rest), np.conj(likely), out=np.zeros_like(likely), where=likely != 0.0)
        between = float(np.median(self.level[counted])) if counted.any() else 0.0
        predicted = np.asarray(fft.irfft(np.where(np.arange(self.rest.size) > 0, self.predicted, 0.0), n))
        errors = rounding_in_residual(self.record, self.span, predicted, self.used, between, transfer, self.turns)
        moved = np.divide(likely, transfer, out=np.zeros_like(likely), where=power_of(transfer) > 0.0)
        freedom = float(np.sum(self.one_sided[counted])) * float(self.used.mean()) - len(basis)
        return Part(
            self.record,
            self.span.start / self.record.sampling_rate_hz,
            self.used,
            predicted,
            likely,
            self.motion,
            np.asarray(fft.irfft(moved, n)),
            transfer,
            whitening,
            basis,
            residual,
            whitened,
            slow_profile(beside, self.used),
            freedom - (0.0 if pull is None else len(whitened)),
            np.zeros((0, n)) if errors is None else white(np.asarray(fft.rfft(errors * self.used, axis=-1))),
            white(np.concatenate([effects * likely, among[None]])),
            doubt,
            pull,
            self.turns,
            self.jacobian,
            lambda columns: self.in_noise_beside(columns).part(effects),
        )

    def _doubt(self, transfer: ComplexArray) -> FloatArray:
        """Part of the noise that one standard uncertainty of σx² makes, behind the sensor, shape (bins,)."""
        found = np.asarray(self.spectrum.doubt()) * power_of(transfer) * self.unit**2 / (DOUBT * self.level)
        return np.asarray(np.minimum(found, 1.0))


def most_likely(
    predicted: ComplexArray, rest: ComplexArray, transfer: ComplexArray, spectrum: NoiseSpectrum, used: BoolArray
) -> ComplexArray:
    """Response to the most likely motion, zero where noise may be all of it, shape (bins,).

    X̂ = X + σx² H* R/S: its error is independent of the residual R, as that of the reference X is not.

    Args:
        predicted: response to the reference, in the unit of the spectrum, shape (bins,).
        rest: residual less nuisance parameters, likewise.
        transfer: of the sensor, shape (bins,).
        spectrum: of the noise.
        used: samples that count, shape (n,).
    """
    level = np.asarray(spectrum.psd)
    share = np.minimum(spectrum.input_noise_at * power_of(transfer) / level, 1.0)
    likely = predicted + share * rest
    unsure = np.where(share > 0.0, share * (1.0 - share), 1.0) * level * float(used.sum())
    return np.asarray(likely * (power_of(likely) > HEARD * unsure))


def projected(bins: ComplexArray, columns: ComplexArray, root: FloatArray) -> ComplexArray:
    """Bins less the columns that fit them best, each bin weighted by ``root``; shape (bins,)."""
    if not len(columns):
        return bins
    size = np.sqrt(np.sum(power_of(columns * root), axis=1, keepdims=True))
    unit = np.divide(columns, size, out=np.zeros_like(columns), where=size > 0.0)
    flat, right = (np.ascontiguousarray(rows * root).view(float) for rows in (unit, bins[None]))
    values, vectors = np.linalg.eigh(flat @ flat.T)
    kept = values > ROUNDING * max(float(values[-1]), 1e-300)
    share = (vectors[:, kept] / values[kept]) @ (vectors[:, kept].T @ (flat @ right[0]))
    return bins - share @ unit

"""Errors of a recording channel: white and 1/f noise, mains hum, offset, drift, clipping, quantisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from vibrident.measure.lines import fast_length
from vibrident.records import FloatArray
from vibrident.simulation.checks import require, require_choice, require_finite, require_not_negative, require_positive


@dataclass(frozen=True)
class ChannelNoise:
    """Errors of one channel. The default has none.

    Attributes:
        white: rms of Gaussian white noise.
        flicker: rms of Gaussian 1/f noise, from 1/(2 · duration) to half the sampling rate.
        hum: rms of the mains fundamental, its phase random for every record.
        hum_frequency_hz: mains frequency, Hz.
        hum_harmonics: rms of the fundamental and its harmonics relative to ``hum``; those above half the sampling rate
            are left out, as an anti-alias filter would.
        offset: constant.
        drift: change from the first to the last sample, linear in time.
        unit: what the levels above are in: ``rms``, fractions of the record's own true rms in this channel, or
            ``channel``, the channel's unit.
        full_scale: largest magnitude the channel can hold, in its unit; beyond it the signal is clipped. None: no
            limit.
        bits: of the converter, two's complement over ± full_scale; None: no quantisation.

    Raises:
        InputError: a level cannot be used, or there are bits without a full scale.
    """

    white: float = 0.0
    flicker: float = 0.0
    hum: float = 0.0
    hum_frequency_hz: float = 50.0
    hum_harmonics: tuple[float, ...] = (1.0, 0.1, 0.3, 0.05, 0.2)
    offset: float = 0.0
    drift: float = 0.0
    unit: Literal["rms", "channel"] = "rms"
    full_scale: float | None = None
    bits: int | None = None

    def __post_init__(self) -> None:
        where = "ChannelNoise"
        require_not_negative(where, white=self.white, flicker=self.flicker, hum=self.hum)
        require_positive(where, hum_frequency_hz=self.hum_frequency_hz)
        require_finite(where, offset=self.offset, drift=self.drift)
        require_choice("The unit of the channel noise", self.unit, ("rms", "channel"))
        if self.full_scale is not None:
            require_positive(where, full_scale=self.full_scale)
        require(
            self.bits is None or (self.full_scale is not None and 1 <= self.bits <= 64),
            "The quantisation of the channel is not usable.",
            expected="bits from 1 to 64, with a full_scale",
            found=f"bits = {self.bits}, full_scale = {self.full_scale}",
            where=where,
            remedy="give both, or neither",
        )

    @property
    def words(self) -> str:
        """Description for a record's history; empty without errors."""
        unit = " of the rms" if self.unit == "rms" else ""
        levels = ("white", "flicker", "hum", "offset", "drift")
        said = [f"{name} {getattr(self, name):.6g}{unit}" for name in levels if getattr(self, name)]
        if self.full_scale is not None:
            said.append(f"full scale {self.full_scale:.6g}")
        if self.bits is not None:
            said.append(f"{self.bits} bits")
        return ", ".join(said)

    def applied(self, truth: FloatArray, sampling_rate_hz: float, rng: np.random.Generator) -> FloatArray:
        """The channel's samples for a true signal.

        Args:
            truth: shape (samples,).
            sampling_rate_hz: samples per second.
            rng: the channel's own stream.

        Returns:
            Shape (samples,), in the unit of ``truth``.
        """
        samples = truth.shape[0]
        one = float(np.sqrt(np.mean(np.square(truth)))) if self.unit == "rms" else 1.0
        signal = np.array(truth, dtype=float)
        if self.white:
            signal += rng.standard_normal(samples) * (self.white * one)
        if self.flicker:
            signal += _flicker(samples, rng) * (self.flicker * one)
        if self.hum:
            signal += self._hum(samples, sampling_rate_hz, rng) * (self.hum * one)
        if self.offset or self.drift:
            signal += one * (self.offset + self.drift * np.linspace(0.0, 1.0, samples))
        return self._converted(signal)

    def _hum(self, samples: int, sampling_rate_hz: float, rng: np.random.Generator) -> FloatArray:
        time = np.arange(samples) / sampling_rate_hz
        phases = rng.uniform(0.0, 2.0 * np.pi, len(self.hum_harmonics))
        hum = np.zeros(samples)
        for order, (level, phase) in enumerate(zip(self.hum_harmonics, phases, strict=True), start=1):
            if order * self.hum_frequency_hz < 0.5 * sampling_rate_hz:
                hum += np.sqrt(2.0) * level * np.cos(2.0 * np.pi * order * self.hum_frequency_hz * time + phase)
        return hum

    def _converted(self, signal: FloatArray) -> FloatArray:
        if self.full_scale is None:
            return signal
        if self.bits is None:
            return np.clip(signal, -self.full_scale, self.full_scale)
        step = self.full_scale * 2.0 ** (1 - self.bits)
        return np.clip(np.rint(signal / step) * step, -self.full_scale, self.full_scale - step)


def _flicker(samples: int, rng: np.random.Generator) -> FloatArray:
    """Gaussian noise of expected rms 1 with power ∝ 1/f, cut out of a period of twice the record."""
    period = fast_length(2 * samples)
    harmonic = np.arange(1, (period + 1) // 2)
    shape = harmonic**-0.5 / np.sqrt(np.sum(1.0 / harmonic))
    parts = rng.standard_normal((2, harmonic.size))
    spectrum = np.zeros(period // 2 + 1, dtype=complex)
    spectrum[1 : harmonic.size + 1] = 0.5 * shape * (parts[0] + 1j * parts[1])
    return np.fft.irfft(spectrum, period, norm="forward")[:samples]

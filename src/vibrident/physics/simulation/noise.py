"""Errors of a recording channel, and noise motion of the base.

The sensor responds to such motion, and the reference measures it. The paper superimposes white
noise on the excitation (section 4). Between samples it must be defined: here it is Gaussian noise
that is exactly band-limited, by default to 0.4 of the sampling rate, as behind an anti-alias
filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import Excitation, FloatArray
from vibrident.physics.simulation.checks import (
    require,
    require_choice,
    require_finite,
    require_not_negative,
    require_positive,
)
from vibrident.physics.simulation.motion import Tonal, Tones

#: Upper band limit over the sampling rate.
DEFAULT_BAND_EDGE = 0.4
#: Period of the noise over the length of the record: its end is independent of its beginning.
PERIOD_RATIO = 1.25


@dataclass(frozen=True)
class ChannelNoise:
    """Errors of one channel. The default has none.

    Attributes:
        white: rms of Gaussian white noise.
        flicker: rms of Gaussian 1/f noise, from 1/(2 · duration) to half the sampling rate.
        hum: rms of the mains fundamental, its phase random for every record.
        hum_frequency_hz: mains frequency, Hz.
        hum_harmonics: rms of the fundamental and its harmonics relative to ``hum``; those above
            half the sampling rate are left out, as an anti-alias filter would.
        offset: constant.
        drift: change from the first to the last sample, linear in time.
        unit: what the levels above are in: ``rms``, fractions of the record's own true rms in this
            channel, or ``channel``, the channel's unit.
        full_scale: largest magnitude the channel can hold, in its unit; beyond it the signal is
            clipped. None: no limit.
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
        """Return the errors in words, for a record's history; empty without any."""
        unit = " of the rms" if self.unit == "rms" else ""
        levels = ("white", "flicker", "hum", "offset", "drift")
        errors = [
            f"{name} {getattr(self, name):.6g}{unit}" for name in levels if getattr(self, name)
        ]
        if self.full_scale is not None:
            errors.append(f"full scale {self.full_scale:.6g}")
        if self.bits is not None:
            errors.append(f"{self.bits} bits")
        return ", ".join(errors)

    def applied(
        self, truth: FloatArray, sampling_rate_hz: float, rng: np.random.Generator
    ) -> FloatArray:
        """Return the channel's samples for a true signal.

        ``truth``: shape (samples,); ``rng``: the channel's own stream. Returns shape (samples,), in
        the unit of ``truth``.
        """
        samples = truth.shape[0]
        unit = float(np.sqrt(np.mean(np.square(truth)))) if self.unit == "rms" else 1.0
        signal = np.array(truth, dtype=float)
        if self.white:
            signal += rng.standard_normal(samples) * (self.white * unit)
        if self.flicker:
            signal += _flicker(samples, rng) * (self.flicker * unit)
        if self.hum:
            signal += self._hum(samples, sampling_rate_hz, rng) * (self.hum * unit)
        if self.offset or self.drift:
            signal += unit * (self.offset + self.drift * np.linspace(0.0, 1.0, samples))
        return self._converted(signal)

    def _hum(self, samples: int, sampling_rate_hz: float, rng: np.random.Generator) -> FloatArray:
        time = np.arange(samples) / sampling_rate_hz
        phases = rng.uniform(0.0, 2.0 * np.pi, len(self.hum_harmonics))
        hum = np.zeros(samples)
        for order, (level, phase) in enumerate(
            zip(self.hum_harmonics, phases, strict=True), start=1
        ):
            if order * self.hum_frequency_hz < 0.5 * sampling_rate_hz:
                hum += (
                    np.sqrt(2.0)
                    * level
                    * np.cos(2.0 * np.pi * order * self.hum_frequency_hz * time + phase)
                )
        return hum

    def _converted(self, signal: FloatArray) -> FloatArray:
        if self.full_scale is None:
            return signal
        if self.bits is None:
            return np.clip(signal, -self.full_scale, self.full_scale)
        step = self.full_scale * 2.0 ** (1 - self.bits)
        return np.clip(np.rint(signal / step) * step, -self.full_scale, self.full_scale - step)


def _flicker(samples: int, rng: np.random.Generator) -> FloatArray:
    """Return Gaussian noise of expected rms 1 with power ∝ 1/f, shape (samples,).

    It is cut out of a period of twice the record.
    """
    period = fast_length(2 * samples)
    harmonic = np.arange(1, (period + 1) // 2)
    shape = harmonic**-0.5 / np.sqrt(np.sum(1.0 / harmonic))
    normal = rng.standard_normal((2, harmonic.size))
    spectrum = np.zeros(period // 2 + 1, dtype=complex)
    spectrum[1 : harmonic.size + 1] = 0.5 * shape * (normal[0] + 1j * normal[1])
    return np.fft.irfft(spectrum, period, norm="forward")[:samples]


@dataclass(frozen=True, eq=False)
class ExcitationNoise(Tonal):
    """Realisation of noise motion: tones with Gaussian phasors at multiples of a fundamental.

    Attributes:
        realisation: the tones, m/s².
        words: for a record's history.
    """

    realisation: Tones
    words: str
    kind: Excitation = "random"

    @property
    def tones(self) -> Tones:
        """Return the tones, m/s²."""
        return self.realisation


def excitation_noise(
    rms: float,
    *,
    sampling_rate_hz: float,
    samples: int,
    rng: np.random.Generator,
    band_hz: tuple[float, float] | None = None,
) -> ExcitationNoise:
    """Draw flat Gaussian acceleration noise for one record.

    Args:
        rms: expected rms, m/s²; a realisation's own differs by chance (1 % for 5000 tones).
        sampling_rate_hz: of the record; the noise itself is continuous.
        samples: length of the record; the noise repeats after 1.25 times as many, or some more.
        rng: where the randomness comes from.
        band_hz: lowest and highest frequency; None: all up to 0.4 of the sampling rate.

    Raises:
        InputError: the rms is negative, or the band is empty or reaches half the sampling rate.
    """
    where = "excitation_noise"
    require_not_negative(where, rms=rms)
    require_positive(where, sampling_rate_hz=sampling_rate_hz, samples=samples)
    low, high = band_hz if band_hz is not None else (0.0, DEFAULT_BAND_EDGE * sampling_rate_hz)
    require(
        0.0 <= low < high < 0.5 * sampling_rate_hz,
        "The band of the noise on the excitation is not usable.",
        expected=f"0 <= low < high < {0.5 * sampling_rate_hz:g} Hz (half the sampling rate)",
        found=f"{low:g} to {high:g} Hz",
        where=where,
        remedy="correct the band, or raise the sampling rate",
    )
    period = fast_length(int(np.ceil(PERIOD_RATIO * samples)))
    fundamental = float(sampling_rate_hz / period)
    harmonic = np.arange(
        max(1, int(np.ceil(low / fundamental))), int(np.floor(high / fundamental)) + 1
    )
    require(
        harmonic.size > 0,
        "The band of the noise on the excitation is too narrow for the record.",
        expected=f"a multiple of {fundamental:g} Hz within the band",
        found=f"{low:g} to {high:g} Hz",
        where=where,
        remedy="widen the band, or take a longer record",
    )
    normal = rng.standard_normal((2, harmonic.size))
    phasor = (normal[0] + 1j * normal[1]) * (rms / np.sqrt(harmonic.size))
    words = (
        f"noise on the excitation, felt by the sensor: {rms:.4g} m/s² rms, "
        f"{low:.6g} to {high:.6g} Hz"
    )
    return ExcitationNoise(Tones(harmonic.astype(float) * fundamental, phasor, fundamental), words)

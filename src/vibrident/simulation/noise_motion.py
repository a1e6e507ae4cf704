"""Noise motion of the base on top of the excitation: the sensor responds to it and the reference measures it.

The paper superimposes white noise on the excitation (section 4). Between samples it must be defined: here it is
Gaussian noise that is exactly band-limited, by default to 0.4 of the sampling rate, as behind an anti-alias filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.measure.lines import fast_length
from vibrident.records import Excitation
from vibrident.simulation.checks import require, require_not_negative, require_positive
from vibrident.simulation.motion import Tonal
from vibrident.simulation.tones import Tones

DEFAULT_BAND = 0.4  # upper band limit as a fraction of the sampling rate
#: The noise repeats after this many times the record's length, so that its end is independent of its beginning.
_PERIOD = 1.25


@dataclass(frozen=True, eq=False)
class ExcitationNoise(Tonal):
    """One realisation of noise motion: tones with Gaussian phasors at the multiples of one fundamental.

    Attributes:
        realisation: the tones, m/s².
        words: for a record's history.
    """

    realisation: Tones
    words: str
    kind: Excitation = "random"

    @property
    def tones(self) -> Tones:
        """The tones, m/s²."""
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
    low, high = band_hz if band_hz is not None else (0.0, DEFAULT_BAND * sampling_rate_hz)
    require(
        0.0 <= low < high < 0.5 * sampling_rate_hz,
        "The band of the noise on the excitation is not usable.",
        expected=f"0 <= low < high < {0.5 * sampling_rate_hz:g} Hz (half the sampling rate)",
        found=f"{low:g} to {high:g} Hz",
        where=where,
        remedy="correct the band, or raise the sampling rate",
    )
    period = fast_length(int(np.ceil(_PERIOD * samples)))
    fundamental = float(sampling_rate_hz / period)
    harmonic = np.arange(max(1, int(np.ceil(low / fundamental))), int(np.floor(high / fundamental)) + 1)
    require(
        harmonic.size > 0,
        "The band of the noise on the excitation is too narrow for the record.",
        expected=f"a multiple of {fundamental:g} Hz within the band",
        found=f"{low:g} to {high:g} Hz",
        where=where,
        remedy="widen the band, or take a longer record",
    )
    parts = rng.standard_normal((2, harmonic.size))
    phasor = (parts[0] + 1j * parts[1]) * (rms / np.sqrt(harmonic.size))
    words = f"noise on the excitation, felt by the sensor: {rms:.4g} m/s² rms, {low:.6g} to {high:.6g} Hz"
    return ExcitationNoise(Tones(harmonic.astype(float) * fundamental, phasor, fundamental), words)

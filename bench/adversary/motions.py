"""The motions: sine, multisine, sweep, random, shock, as tones below half the sampling rate."""

from __future__ import annotations

import numpy as np

from bench.adversary.physics import TAU, Motion, Real

#: A motion on a periodic grid repeats after this many lengths of the record: its ends do not meet
#: within it.
PERIOD = 1.37
NEGLIGIBLE_LINE = 1e-13  # lines of sweeps and shocks below this part of the largest are nothing


def sine(frequency_hz: float, amplitude: float, rng: np.random.Generator) -> Motion:
    """Return a tone at any phase."""
    return Motion(np.array([frequency_hz]), amplitude * _phases(1, rng))


def multisine(frequencies_hz: Real, rms: float, rng: np.random.Generator) -> Motion:
    """Tones of one size at any phases."""
    count = len(frequencies_hz)
    return Motion(
        np.asarray(frequencies_hz, dtype=float), rms * np.sqrt(2.0 / count) * _phases(count, rng)
    )


def random(
    band_hz: tuple[float, float], rms: float, samples: int, rate: float, rng: np.random.Generator
) -> Motion:
    """Gaussian noise, level within the band and nothing outside."""
    period = int(PERIOD * samples)
    lines = np.arange(
        max(1, int(np.ceil(band_hz[0] * period / rate))), int(band_hz[1] * period / rate) + 1
    )
    lines = lines[lines < period / 2]
    size = rng.normal(size=lines.size) + 1j * rng.normal(size=lines.size)
    return Motion(lines * rate / period, rms / np.sqrt(lines.size) * size)


def sweep(band_hz: tuple[float, float], rms: float, samples: int, rate: float) -> Motion:
    """Return a logarithmic sweep over nine tenths of the record, faded in and out, and rest."""
    period = int(PERIOD * samples)
    length = int(0.9 * samples)
    x = np.arange(length) / length
    ratio = np.log(band_hz[1] / band_hz[0])
    phase = TAU * band_hz[0] * length / rate * np.expm1(ratio * x) / ratio
    fade = np.clip(np.minimum(x, 1.0 - x) / 0.05, 0.0, 1.0)
    drive = np.zeros(period)
    begin = int(0.03 * samples)
    drive[begin : begin + length] = np.sin(phase) * np.sin(0.5 * np.pi * fade) ** 2
    return _of_samples(drive, rate, limit=0.42).scaled(rms * np.sqrt(2.0))


def shock(duration_s: float, peak: float, samples: int, rate: float) -> Motion:
    """Return a bell-shaped push, a quarter into the record, with no net velocity.

    ``duration``: at a tenth of its peak.
    """
    period = int(PERIOD * samples)
    t = np.arange(period) / rate - 0.25 * samples / rate
    width = duration_s / 4.292  # exp(-x²/2) is a tenth at ±2.146
    later = 6.0 * width
    push = np.exp(-0.5 * (t / width) ** 2) - 0.25 * np.exp(
        -0.5 * ((t - 2.0 * later) / (4.0 * width)) ** 2
    )
    return _of_samples(push, rate, limit=0.45).scaled(peak)


def gated(motion: Motion, samples: int, rate: float, rest_fraction: float) -> Motion:
    """Return the motion after a rest over the first part of the record, with a smooth start."""
    period = int(PERIOD * samples)
    t = np.arange(period) / rate
    x = np.arange(period) / samples
    gate = np.sin(0.5 * np.pi * np.clip((x - rest_fraction) / 0.05, 0.0, 1.0)) ** 2
    gate *= np.sin(0.5 * np.pi * np.clip((PERIOD - x) / 0.05, 0.0, 1.0)) ** 2
    values = motion.acceleration(t) * gate
    return _of_samples(values, rate, limit=0.45)


def _of_samples(values: Real, rate: float, limit: float) -> Motion:
    """Return the periodic motion through samples, without parts above ``limit`` or at rest."""
    spectrum = np.fft.rfft(values) * 2.0 / values.size
    frequency = np.fft.rfftfreq(values.size, 1.0 / rate)
    keep = (
        (frequency > 0.0)
        & (frequency < limit * rate)
        & (np.abs(spectrum) > NEGLIGIBLE_LINE * np.abs(spectrum).max())
    )
    last = int(np.flatnonzero(keep)[-1])
    keep[1 : last + 1] = True
    return Motion(frequency[keep], spectrum[keep])


def _phases(count: int, rng: np.random.Generator) -> np.ndarray:
    return np.exp(1j * TAU * rng.random(count))

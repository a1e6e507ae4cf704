"""Noise that recording adds to both channels: several colours, hum, quantisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.adversary.physics import TAU, Real

#: Exponent of 1/f in the power of coloured noise.
POWERS = {"pink": 1.0, "brown": 2.0}


@dataclass(frozen=True)
class Noise:
    """Noise of a recording; all levels are relative to the rms of the channel.

    Attributes:
        name: short.
        response: standard deviation on the response.
        reference: standard deviation on the reference, which the sensor does not feel.
        colour: ``white``, ``pink`` (1/f in power), ``brown`` (1/f² in power), ``ar2`` (a broad peak
            drawn within the band) or ``growing`` (three times as strong at the end as at the
            start).
        hum: amplitude of mains hum on the response.
        felt: rms of vibration that the sensor feels beside the motion, over the rms of the motion.
        bits: of both converters, whose range is twice the peak; 0: none.
        reference_colour: of the noise of the reference, as ``colour``.
    """

    name: str
    response: float
    reference: float = 0.0
    colour: str = "white"
    hum: float = 0.0
    felt: float = 0.0
    bits: int = 0
    reference_colour: str = "white"


def added(values: Real, level: float, colour: str, rng: np.random.Generator) -> Real:
    """Return the channel with noise of this level."""
    if level <= 0.0:
        return values
    size = values.size
    noise = rng.normal(size=size)
    if colour in POWERS:
        spectrum = np.fft.rfft(rng.normal(size=2 * size))
        spectrum[1:] /= np.arange(1, spectrum.size) ** (0.5 * POWERS[colour])
        spectrum[0] = 0.0
        noise = np.fft.irfft(spectrum)[:size]
    elif colour == "ar2":
        noise = second_order(size, rng)
    elif colour == "growing":
        noise = noise * np.linspace(0.5, 1.5, size)
    return values + level * rms(values) * noise / rms(noise - noise.mean())


def second_order(size: int, rng: np.random.Generator) -> Real:
    """Return autoregressive noise of order two with a drawn pole: a broad peak."""
    from scipy.signal import lfilter  # 0.4 s, and most cases need none

    radius = rng.uniform(0.7, 0.98)
    angle = np.pi * rng.uniform(0.02, 0.9)
    recursion = [1.0, -2.0 * radius * np.cos(angle), radius**2]
    settling = int(40.0 / (1.0 - radius))
    return np.asarray(lfilter([1.0], recursion, rng.normal(size=size + settling)))[settling:]


def hum(values: Real, level: float, rate: float, mains_hz: float, rng: np.random.Generator) -> Real:
    """Return the channel with mains hum and its third harmonic."""
    t = np.arange(values.size) / rate
    first, third = rng.random(2)
    wave = np.cos(TAU * (mains_hz * t + first)) + 0.3 * np.cos(TAU * (3.0 * mains_hz * t + third))
    return values + level * np.sqrt(2.0) * rms(values) * wave


def quantised(values: Real, bits: int, full_scale: float) -> Real:
    """Return a signal as a converter of this range, ± full scale, gives it."""
    step = 2.0 * full_scale / 2**bits
    return step * np.clip(np.rint(values / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def rms(values: Real) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def recorded_channel(values: Real, noise: Noise, rng: np.random.Generator) -> Real:
    """Return a channel with the noise of its recording, without hum."""
    values = added(values, noise.response, noise.colour, rng)
    return (
        quantised(values, noise.bits, 2.0 * float(np.max(np.abs(values)))) if noise.bits else values
    )

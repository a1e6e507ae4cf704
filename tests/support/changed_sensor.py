"""Records of a sensor that changes: exact, by its steady response and free motion from each change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrident import Calibration

Real = NDArray[np.float64]


@dataclass(frozen=True)
class Life:
    """A sensor from one sample on.

    Attributes:
        first: the sample.
        natural_hz: natural frequency.
        damping: damping ratio.
        gain: sensitivity; it changes at the output, the mass moves on.
    """

    first: int
    natural_hz: float
    damping: float
    gain: float

    @property
    def values(self) -> Real:
        """Sensitivity, natural frequency and damping ratio."""
        return np.array([self.gain, self.natural_hz, self.damping])

    def steady(self, u: Real, rate_hz: float) -> tuple[Real, Real]:
        """Place and velocity of the mass for a motion that recurs."""
        hz = np.fft.rfftfreq(len(u), 1.0 / rate_hz)
        over = hz / self.natural_hz
        bins = np.fft.rfft(u) / (1.0 - over**2 + 2j * self.damping * over)
        return np.fft.irfft(bins, len(u)), np.fft.irfft(2j * np.pi * hz * bins, len(u))


def noise_in_band(rng: np.random.Generator, samples: int, rate_hz: float, band_hz: tuple[float, float]) -> Real:
    """Random motion in a band, rms about one, that recurs."""
    hz = np.fft.rfftfreq(samples, 1.0 / rate_hz)
    bins = rng.normal(size=(2, hz.size)) * ((hz > band_hz[0]) & (hz < band_hz[1]))
    motion = np.fft.irfft(bins[0] + 1j * bins[1], samples)
    return motion / np.std(motion)


def answered(u: Real, rate_hz: float, lives: Sequence[Life]) -> Real:
    """Response of a sensor whose mass keeps its place and velocity at each change."""
    response = np.empty_like(u)
    edges = [*(life.first for life in lives), len(u)]
    state: tuple[float, float] | None = None
    for life, last in zip(lives, edges[1:], strict=True):
        displacement, velocity = life.steady(u, rate_hz)
        time_s = np.arange(last - life.first + 1) / rate_hz
        span = np.minimum(np.arange(life.first, last + 1), len(u) - 1)
        pole = 2.0 * np.pi * life.natural_hz * (-life.damping + 1j * np.sqrt(1.0 - life.damping**2))
        free = np.zeros(len(time_s), dtype=complex)
        if state is not None:
            off, slope = state[0] - displacement[life.first], state[1] - velocity[life.first]
            free = (off + 1j * (pole.real * off - slope) / pole.imag) * np.exp(pole * time_s)
        response[life.first : last] = life.gain * (displacement[span] + free.real)[:-1]
        state = float(displacement[span[-1]] + free[-1].real), float(velocity[span[-1]] + (pole * free[-1]).real)
    return response


def calibration(
    rng: np.random.Generator, lives: Sequence[Life], samples: int, noise: float, rate_hz: float = 8000.0
) -> Calibration:
    """A record of random motion with white noise of this part of the response's rms."""
    u = noise_in_band(rng, samples, rate_hz, (10.0, 1500.0))
    y = answered(u, rate_hz, lives)
    y = y + noise * np.std(y[: lives[1].first] if len(lives) > 1 else y) * rng.normal(size=samples)
    return Calibration.from_arrays(u, y, rate_hz, quantity="acceleration", excitation="random")

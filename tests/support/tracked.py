"""Long motions and the exact response of a sensor to them, for trackers."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from tests.support.random_record import RATE_HZ, TRUTH, Real

from vibrident.physics.models import parse
from vibrident.use.tracking.state import TrackerSettings
from vibrident.use.tracking.tracker import Tracker

BAND_HZ = (20.0, 4000.0)
USUAL = TrackerSettings()
ACCELEROMETER = parse("accelerometer")


def transfer(hz: Real, values: Mapping[str, float] = TRUTH, model: str = "accelerometer") -> NDArray[np.complex128]:
    """Response of a sensor to acceleration, at frequencies above zero."""
    return np.asarray(parse(model).frequency_response(values, hz))


def motion(kind: str, samples: int, rng: np.random.Generator) -> Real:
    """Periodic motion of so many samples, rms about one: random, multisine, sweep or tone."""
    t, (low, high) = np.arange(samples) / RATE_HZ, BAND_HZ
    if kind == "sweep":
        length = samples / RATE_HZ
        rate = np.log(high / low) / length
        shape = np.minimum(1.0, 20.0 * np.minimum(t, length - t) / length)
        return np.sqrt(2.0) * shape * np.sin(2.0 * np.pi * low / rate * np.expm1(rate * t))
    lines = np.fft.rfftfreq(samples, 1.0 / RATE_HZ)
    inside = (lines > low) & (lines < high)
    if kind == "tone":
        chosen = np.argmin(np.abs(lines - 317.0))[None]
    elif kind == "multisine":
        chosen = np.unique(np.searchsorted(lines, np.geomspace(low, high, 60)))
    else:
        chosen = np.flatnonzero(inside)
    spectrum = np.zeros(lines.size, complex)
    phases = np.exp(2j * np.pi * rng.random(chosen.size))
    spectrum[chosen] = phases * (np.abs(rng.normal(size=(2, chosen.size))).sum(0) if kind == "random" else 1.0)
    signal = np.fft.irfft(spectrum, samples)
    return signal / np.std(signal)


def answered(u: Real, values: Mapping[str, float] = TRUTH, model: str = "accelerometer") -> Real:
    """Exact steady response to a periodic motion."""
    hz = np.fft.rfftfreq(len(u), 1.0 / RATE_HZ)
    hz[0] = hz[1]
    response = transfer(hz, values, model)
    response[0] = response[0].real
    return np.fft.irfft(np.fft.rfft(u) * response, len(u))


def record(
    kind: str, samples: int, rng: np.random.Generator, noise: float = 0.01, values: Mapping[str, float] = TRUTH
) -> tuple[Real, Real]:
    """A piece of a motion and the response to it, with white noise of this part of its rms."""
    extra = 0 if kind == "sweep" else samples // 3  # the piece is then not a whole period
    u = motion(kind, samples + extra, rng)
    y = answered(u, values)
    y += noise * np.std(y) * rng.normal(size=len(y))
    return u[:samples], y[:samples]


def tracker(
    rng: np.random.Generator | None = None, u: float = 0.05, off: float = 0.02, settings: TrackerSettings = USUAL
) -> Tracker:
    """From start values off by normal errors of ``off``, stated with a relative uncertainty ``u``."""
    errors = np.zeros(3) if rng is None else off * rng.normal(size=3)
    start = {name: value * (1.0 + e) for (name, value), e in zip(TRUTH.items(), errors, strict=True)}
    covariance = np.diag([(u * value) ** 2 for value in TRUTH.values()])
    return Tracker(ACCELEROMETER, start, covariance, RATE_HZ, settings=settings)


def fed(sensor_tracker: Tracker, u: Real, y: Real, cuts: Callable[[int], list[int]] = lambda n: []) -> Tracker:
    """The tracker after these samples, cut into chunks at ``cuts``."""
    for a, b in zip(np.split(u, cuts(len(u))), np.split(y, cuts(len(u))), strict=True):
        sensor_tracker.feed(a, b)
    sensor_tracker.finish()
    return sensor_tracker

"""Inputs held between samples or joined by lines: steps, telegraph signals, stairs, noise."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.polynomial import polynomial as poly

from bench.adversary.defects import Raw
from bench.adversary.draws import describe, draw_noise, faulty_trial, log_uniform
from bench.adversary.physics import TAU, Real, Sensor
from bench.adversary.recording import recorded, setting
from bench.adversary.trial import Cases, Trial

SENSORS = (
    "in-light",
    "in-damped",
    "below-damped",
    "in-over",
    "pickup-below-damped",
    "pickup-in-light",
)
KINDS = ("single step", "pulse", "telegraph", "staircase", "stairs of a sweep", "stairs of noise")
#: Stairs of which each tread is one sample.
WHITE = "white noise"
QUANTITIES = ("drive", "acceleration")


def cases() -> Cases:
    """Return the names and makers of inputs that are held, as by a converter."""
    for kind, sensor in itertools.product(KINDS, SENSORS):
        yield f"{kind}/{sensor}", partial(_maker, kind, sensor, held_response)


def joined() -> Cases:
    """Return the names and makers of inputs that are joined by lines, as ``lsim`` does."""
    for kind, sensor in itertools.product(("telegraph", "staircase", WHITE), SENSORS):
        yield f"{kind}/{sensor}", partial(_maker, kind, sensor, joined_response)


def _maker(
    kind: str,
    sensor: str,
    respond: Callable[[Sensor, Real, float], Real],
    rng: np.random.Generator,
) -> Trial:
    conditions = replace(setting(sensor, rng), quantity=str(rng.choice(QUANTITIES)))
    noise = draw_noise(rng, (1e-4, 1e-2))
    count, samples = ((1, 8000), (1, 3000), (4, 1500))[rng.integers(3)]
    period = conditions.rate / conditions.sensor.parameters["natural_frequency"]
    hold = max(1, round(log_uniform(0.05, 1.5, rng) * period))
    hold = 1 if kind == WHITE else hold
    recordings = []
    for i in range(count):
        levels = stairs(kind, samples, hold, period, rng)
        response = respond(conditions.sensor, levels, conditions.rate)
        channels = recorded(levels, response, conditions.rate, noise, rng)
        recordings.append(Raw(f"held-{i}", *channels, conditions.rate, "random"))
    described = describe(conditions, recordings, noise, sensor)
    cause = "held input" if respond is held_response else "input joined by lines"
    text = f"level for {hold} samples, {period:.1f} a period; {described}"
    return faulty_trial(recordings, None, conditions, cause, text)


def stairs(kind: str, samples: int, hold: int, period: float, rng: np.random.Generator) -> Real:
    """Return levels that a held input has at the samples; ``period``: of the sensor, in samples."""
    steps = samples // hold + 1
    t = np.arange(steps) * hold
    if kind in ("single step", "pulse"):
        begin = int(samples * rng.uniform(0.03, 0.3))
        levels = np.zeros(samples)
        levels[begin : begin + int(samples * rng.uniform(0.1, 0.3))] = 1.0
        if kind == "single step":
            levels[begin:] = 1.0
        return levels
    if kind == "telegraph":
        values = rng.choice([-1.0, 1.0], steps)
    elif kind == "staircase":
        values = np.cumsum(rng.choice([-1.0, 0.0, 1.0], steps)) * 0.1
    elif kind == "stairs of a sweep":
        low = 0.05 / period
        high = min(3.0 / period, 0.2 / hold)
        values = np.sin(TAU * (low * t + 0.5 * (high - low) * t**2 / samples))
    else:
        smooth = np.fft.rfft(rng.normal(size=2 * steps))
        smooth[int(0.5 * smooth.size) :] = 0.0
        values = np.fft.irfft(smooth)[:steps]
    return np.repeat(values, hold)[:samples]


def held_response(sensor: Sensor, levels: Real, rate: float) -> Real:
    """Return the response, from rest, to an input that keeps each level until the next sample.

    Exactly, pole by pole: ẋ = p x + r u has x(t + T) = e^{pT} x(t) + (e^{pT} − 1) r u / p.
    """
    return _sum_of_poles(sensor, levels, rate, lambda p: (np.expm1(p / rate) / p, 0.0))


def joined_response(sensor: Sensor, levels: Real, rate: float) -> Real:
    """Return the response, from rest, to lines from sample to sample.

    Exactly: ∫ e^{p(T − s)} s/T ds = (e^{pT} − 1 − pT) / p²T is the share of the later sample.
    """

    def shares(pole: complex) -> tuple[complex, complex]:
        later = (np.expm1(pole / rate) - pole / rate) * rate / pole**2
        return np.expm1(pole / rate) / pole - later, later

    return _sum_of_poles(sensor, levels, rate, shares)


def _sum_of_poles(
    sensor: Sensor,
    levels: Real,
    rate: float,
    shares: Callable[[complex], tuple[complex, complex]],
) -> Real:
    """Return the sum of the poles' responses, given the shares of the earlier and later sample."""
    from scipy.signal import lfilter  # 0.4 s, and most cases need none

    top, below = sensor.fraction()
    total = np.zeros(levels.size)
    for pole in sensor.poles():
        residue = poly.polyval(pole, top) / poly.polyval(pole, poly.polyder(below))
        earlier, later = shares(pole)
        gains = residue * np.array([later, earlier])
        total += np.real(lfilter(gains, [1.0, -np.exp(pole / rate)], levels.astype(complex)))
    return total

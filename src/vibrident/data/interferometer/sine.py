"""Sine approximation of ISO 16063-11, method 3: fit amplitude, phase and frequency of a phase.

Slow motion beside a sine is not the sensor's, but the optical table's, the carrier's, or the air's.
It is far larger in displacement than in acceleration, and its ends leak into the sine. Motion below
a third of the sine's frequency is fitted together with the sine, in turns, and removed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from vibrident.data.interferometer.setting import BoolArray, FloatArray

MAX_SAMPLES = 1 << 16  # of the fit
MIN_PERIODS = 0.9
SLOW_TO_SINE = 1.0 / 3.0  # motion is slow below this frequency, over the sine's
MAX_FREQUENCY_RATIO = 1.3  # largest error of an approximate frequency, as a factor


@dataclass(frozen=True)
class FittedSine:
    """Sine with offset and slope: amplitude · cos(2π f t + angle) + mean + slope · t.

    Time t in s from the first sample.
    """

    amplitude: float
    angle: float
    frequency_hz: float
    mean: float
    slope: float

    def wave(self, time_s: FloatArray) -> FloatArray:
        """Return the sine without offset and slope at times in s."""
        return self.amplitude * np.cos(2.0 * np.pi * self.frequency_hz * time_s + self.angle)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the value at times in s."""
        return self.wave(time_s) + self.mean + self.slope * time_s


def fit_sine(
    values: FloatArray,
    valid: BoolArray,
    rate_hz: float,
    near_hz: float | None = None,
    known_hz: float | None = None,
) -> FittedSine | None:
    """Fit a sine, offset and slope to the valid samples; None for less than a period.

    Args:
        values: shape (n,).
        valid: shape (n,).
        rate_hz: sampling rate.
        near_hz: approximate frequency.
        known_hz: frequency of a fit to nearly the same values, from which this one starts.
    """
    index = np.flatnonzero(valid)
    if index.size < 8:
        return None
    every = max(index.size // MAX_SAMPLES, 1)
    first = known_hz or peak_frequency(values, valid, rate_hz, near_hz)
    if every > 1 and first * every > 0.1 * rate_hz:
        every = max(int(0.1 * rate_hz / first), 1)
    index = index[::every]
    time = index / rate_hz
    used = values[index]
    span = float(time[-1] - time[0])
    if first * span < MIN_PERIODS:
        return None
    omega = 2.0 * np.pi * first
    middle = 0.5 * float(time[0] + time[-1])
    t = time - middle
    rows = np.empty((6, t.size))
    rows[2] = 1.0
    rows[3] = t / span
    for _ in range(12):  # steps of the frequency
        change = _frequency_step(rows, used, omega * t)
        omega += float(np.clip(change / span, -np.pi / span, np.pi / span))
        if abs(change) < 1e-9:
            break
    amplitudes, *_ = np.linalg.lstsq(rows[:4].T, used, rcond=None)
    mean = float(amplitudes[2] - amplitudes[3] * middle / span)
    angle = float(np.arctan2(-amplitudes[1], amplitudes[0]) - omega * middle)
    return FittedSine(
        float(np.hypot(amplitudes[0], amplitudes[1])),
        angle,
        omega / (2.0 * np.pi),
        mean,
        float(amplitudes[3]) / span,
    )


def _frequency_step(rows: FloatArray, values: FloatArray, angle: FloatArray) -> float:
    """Return a Gauss–Newton step of the frequency, in radians over the span.

    Fills the rows cos, sin, 1, t, t cos, t sin.
    """
    np.cos(angle, out=rows[0])
    np.sin(angle, out=rows[1])
    np.multiply(rows[3], rows[:2], out=rows[4:])
    normal = rows @ rows.T
    score = rows @ values
    linear = normal[:4, :4] + 1e-14 * values.size * np.eye(4)
    amplitudes = np.linalg.solve(linear, score[:4])
    slope = np.array([0.0, 0.0, 0.0, 0.0, amplitudes[1], -amplitudes[0]])
    products = normal @ slope
    # information of the frequency beside that of the linear rows
    size = float(slope @ products - products[:4] @ np.linalg.solve(linear, products[:4]))
    return float(slope @ score - products[:4] @ amplitudes) / max(size, 1e-300)


def peak_frequency(
    values: FloatArray, valid: BoolArray, rate_hz: float, near_hz: float | None = None
) -> float:
    """Return the frequency of the largest line, Hz.

    Within a factor 1.3 of ``near_hz``; without it, the largest line of the displacement's velocity.
    """
    valid_index = np.flatnonzero(valid)
    index = np.arange(valid_index[0], valid_index[-1] + 1)
    filled = np.interp(index, valid_index, values[valid_index])
    line = np.polynomial.Polynomial.fit(valid_index, values[valid_index], 1)
    filled = (filled - line(index)) * np.hanning(index.shape[0])
    size = int(fft.next_fast_len(2 * index.shape[0], real=True) or 1)
    power = np.abs(np.asarray(fft.rfft(filled, size)))
    lines = np.arange(power.shape[0]) * rate_hz / size
    if near_hz is None:
        power *= lines
    else:
        power[
            (lines < near_hz / MAX_FREQUENCY_RATIO - 2.0 * rate_hz / size)
            | (lines > near_hz * MAX_FREQUENCY_RATIO + 2.0 * rate_hz / size)
        ] = 0.0
    return float(max(int(np.argmax(power)), 1) * rate_hz / size)


def without_slow_motion(
    values: FloatArray, valid: BoolArray, rate_hz: float, near_hz: float | None
) -> tuple[FloatArray, FittedSine | None]:
    """Return the values without slow motion, and the sine in them; None for less than a period.

    Args:
        values: shape (n,).
        valid: shape (n,).
        rate_hz: sampling rate.
        near_hz: approximate frequency of the sine.
    """
    sine = fit_sine(values, valid, rate_hz, near_hz)
    if sine is None:
        return values, None
    index = np.arange(values.shape[0])
    valid_index = np.flatnonzero(valid)
    time = index / rate_hz
    slow = np.zeros(values.shape)
    for _ in range(4):  # rounds of the joint fit
        slow_and_noise = np.interp(index, valid_index, (values - sine.wave(time))[valid_index])
        spectrum = np.asarray(fft.dct(slow_and_noise, type=2))
        spectrum[
            max(int(2.0 * SLOW_TO_SINE * sine.frequency_hz * values.shape[0] / rate_hz), 1) :
        ] = 0.0
        slow = np.asarray(fft.idct(spectrum, type=2))
        refined = fit_sine(values - slow, valid, rate_hz, known_hz=sine.frequency_hz)
        if refined is None:
            break
        done = abs(refined.amplitude / sine.amplitude - 1.0) < 1e-10
        sine = refined
        if done:
            break
    middle = float(np.mean(slow[valid]))
    return values - slow + middle, replace(sine, mean=sine.mean + middle)

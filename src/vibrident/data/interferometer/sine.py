"""The sine-approximation of ISO 16063-11, method 3: amplitude, phase and frequency of the unwrapped phase, by fit.

Slow motion beside a sine is not the sensor's: of the optical table, of the carrier, of the air. It
is far larger in displacement than in acceleration, and its ends leak into the sine. Motion below a
third of the sine's frequency is removed in a few rounds with the fitted sine, which is the joint
fit of both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from vibrident.data.interferometer.setting import BoolArray, FloatArray

MOST = 1 << 16  # most samples of the fit
FEWEST_PERIODS = 0.9  # fewest periods
SLOW = 1.0 / 3.0  # part of the sine's frequency below which motion is slow
NEAR = 1.3  # an approximate frequency is right within this factor


@dataclass(frozen=True)
class Sine:
    """amplitude · cos(2π f t + angle) + mean + slope · t, t in s from the first sample."""

    amplitude: float
    angle: float
    frequency_hz: float
    mean: float
    slope: float

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the value at times in s."""
        wave = self.amplitude * np.cos(2.0 * np.pi * self.frequency_hz * time_s + self.angle)
        return wave + self.mean + self.slope * time_s


def fit_sine(
    values: FloatArray,
    valid: BoolArray,
    rate_hz: float,
    near_hz: float | None = None,
    known_hz: float | None = None,
) -> Sine | None:
    """Fit a sine, offset and slope to the valid samples; None for less than a period.

    ``values``: shape (n,); ``valid``: shape (n,); ``near_hz``: approximate frequency; ``known_hz``:
    frequency of a fit to nearly the same values, from which this one starts.
    """
    index = np.flatnonzero(valid)
    if index.size < 8:
        return None
    every = max(index.size // MOST, 1)
    first = known_hz or peak(values, valid, rate_hz, near_hz)
    if every > 1 and first * every > 0.1 * rate_hz:
        every = max(int(0.1 * rate_hz / first), 1)
    index = index[::every]
    time = index / rate_hz
    seen = values[index]
    span = float(time[-1] - time[0])
    if first * span < FEWEST_PERIODS:
        return None
    omega = 2.0 * np.pi * first
    middle = 0.5 * float(time[0] + time[-1])
    t = time - middle
    rows = np.empty((6, t.size))
    rows[2] = 1.0
    rows[3] = t / span
    for _ in range(12):  # steps of the frequency
        change = _turned(rows, seen, omega * t)
        omega += float(np.clip(change / span, -np.pi / span, np.pi / span))
        if abs(change) < 1e-9:
            break
    found, *_ = np.linalg.lstsq(rows[:4].T, seen, rcond=None)
    mean = float(found[2] - found[3] * middle / span)
    angle = float(np.arctan2(-found[1], found[0]) - omega * middle)
    return Sine(
        float(np.hypot(found[0], found[1])),
        angle,
        omega / (2.0 * np.pi),
        mean,
        float(found[3]) / span,
    )


def _turned(rows: FloatArray, seen: FloatArray, angle: FloatArray) -> float:
    """Return a Gauss–Newton step of the frequency, in radians over the span; fills the rows cos, sin, 1, t, t cos, t sin."""
    np.cos(angle, out=rows[0])
    np.sin(angle, out=rows[1])
    np.multiply(rows[3], rows[:2], out=rows[4:])
    normal = rows @ rows.T
    score = rows @ seen
    linear = normal[:4, :4] + 1e-14 * seen.size * np.eye(4)
    found = np.linalg.solve(linear, score[:4])
    slope = np.array([0.0, 0.0, 0.0, 0.0, found[1], -found[0]])
    along = normal @ slope
    # beside the linear rows
    size = float(slope @ along - along[:4] @ np.linalg.solve(linear, along[:4]))
    return float(slope @ score - along[:4] @ found) / max(size, 1e-300)


def peak(
    values: FloatArray, valid: BoolArray, rate_hz: float, near_hz: float | None = None
) -> float:
    """Return the frequency of the largest line, Hz: within a factor 1.3 of ``near_hz``, else of the displacement's velocity."""
    known = np.flatnonzero(valid)
    index = np.arange(known[0], known[-1] + 1)
    whole = np.interp(index, known, values[known])
    line = np.polynomial.Polynomial.fit(known, values[known], 1)
    whole = (whole - line(index)) * np.hanning(index.shape[0])
    size = int(fft.next_fast_len(2 * index.shape[0], real=True) or 1)
    power = np.abs(np.asarray(fft.rfft(whole, size)))
    lines = np.arange(power.shape[0]) * rate_hz / size
    if near_hz is None:
        power *= lines
    else:
        power[
            (lines < near_hz / NEAR - 2.0 * rate_hz / size)
            | (lines > near_hz * NEAR + 2.0 * rate_hz / size)
        ] = 0.0
    return float(max(int(np.argmax(power)), 1) * rate_hz / size)


def without_slow_motion(
    values: FloatArray, valid: BoolArray, rate_hz: float, near_hz: float | None
) -> tuple[FloatArray, Sine | None]:
    """Return the values without slow motion, and the sine in them; None for less than a period.

    ``values``: shape (n,); ``valid``: shape (n,); ``near_hz``: approximate frequency of the sine.
    """
    found = fit_sine(values, valid, rate_hz, near_hz)
    if found is None:
        return values, None
    index = np.arange(values.shape[0])
    known = np.flatnonzero(valid)
    time = index / rate_hz
    slow = np.zeros(values.shape)
    for _ in range(4):  # rounds of the joint fit
        wave = found.amplitude * np.cos(2.0 * np.pi * found.frequency_hz * time + found.angle)
        rest = np.interp(index, known, (values - wave)[known])
        parts = np.asarray(fft.dct(rest, type=2))
        parts[max(int(2.0 * SLOW * found.frequency_hz * values.shape[0] / rate_hz), 1) :] = 0.0
        slow = np.asarray(fft.idct(parts, type=2))
        again = fit_sine(values - slow, valid, rate_hz, known_hz=found.frequency_hz)
        if again is None:
            break
        done = abs(again.amplitude / found.amplitude - 1.0) < 1e-10
        found = again
        if done:
            break
    middle = float(np.mean(slow[valid]))
    return values - slow + middle, replace(found, mean=found.mean + middle)

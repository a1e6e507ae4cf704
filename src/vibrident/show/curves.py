"""Values of results as arrays, and the curves of a model drawn so that no peak is missed."""

from __future__ import annotations

from collections import Counter

import numpy as np

from vibrident.base.amounts import scaled
from vibrident.result import Curve, MeasuredCurve, Result
from vibrident.show.views import FloatArray, K


def column(curve: Curve, name: str) -> FloatArray:
    """Return a column of a curve, a value per frequency; NaN where it is not known."""
    values = getattr(curve, name)
    points = len(curve.frequency_hz)
    return values if values.size == points else np.full(points, np.nan)


def expanded(curve: Curve, quantity: str) -> FloatArray:
    """Return U (k = 2) of a curve's ``magnitude`` or ``phase_deg``; NaN where it is not known."""
    return K * column(curve, f"{quantity}_uncertainty")


def bars_of_deviation(measured: MeasuredCurve) -> tuple[FloatArray, FloatArray]:
    """Return U (k = 2) of the deviations in percent and degrees; else U of the points."""
    percent = column(measured, "deviation_uncertainty_percent")
    if np.isfinite(percent).any():
        return K * percent, K * column(measured, "deviation_phase_uncertainty_deg")
    return 100.0 * expanded(measured, "magnitude") / column(measured, "magnitude"), expanded(
        measured, "phase_deg"
    )


def continuous(phase_deg: FloatArray) -> FloatArray:
    """Unwrap a phase by whole turns, starting in (−180°, 180°]; NaN stays."""
    out = phase_deg.copy()
    usable = np.isfinite(out)
    if usable.any():
        unwrapped = np.unwrap(out[usable], period=360.0)
        out[usable] = unwrapped - 360.0 * np.ceil((unwrapped[0] - 180.0) / 360.0)
    return out


def nearest_turn(phase_deg: FloatArray, near_deg: FloatArray) -> FloatArray:
    """Move a phase in degrees by whole turns to where it is nearest to another."""
    return phase_deg + 360.0 * np.round((near_deg - phase_deg) / 360.0)


def principal(phase_deg: FloatArray) -> FloatArray:
    """Return the phase in degrees in [−180°, 180°)."""
    return (phase_deg + 180.0) % 360.0 - 180.0


def spread(count: int, limit: int) -> list[int]:
    """Return at most ``limit`` indices, evenly over ``count`` items, first and last included."""
    if count <= limit:
        return list(range(count))
    return [round(i * (count - 1) / (limit - 1)) for i in range(limit)]


def envelope(
    time: FloatArray, values: FloatArray, bins: int = 1500
) -> tuple[FloatArray, FloatArray]:
    """Thin a long line without losing its peaks: the extremes of each bin, in the order of time.

    ``time``: shape (samples,); ``values``: shape (samples,); ``bins``: number of bins.

    Returns:
        time and values, both of shape (at most 2 bins + rest,).
    """
    if len(values) <= 2 * bins:
        return time, values
    width = len(values) // bins
    blocks = values[: bins * width].reshape(bins, width)
    picks = np.sort(np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1), axis=1)
    index = np.concatenate(
        [(picks + width * np.arange(bins)[:, None]).ravel(), np.arange(bins * width, len(values))]
    )
    return time[index], values[index]


def largest(*values: FloatArray) -> float:
    """Return the largest finite magnitude; zero if no value is finite."""
    return max((float(np.abs(v[np.isfinite(v)]).max(initial=0.0)) for v in values), default=0.0)


def record_frequencies(result: Result) -> dict[str, float]:
    """Return the frequency of each record that was excited at one frequency alone, Hz."""
    excited = set(zip(result.measured.record, result.measured.frequency_hz.tolist(), strict=False))
    times = Counter(name for name, _ in excited)
    return {name: frequency for name, frequency in excited if times[name] == 1}


def from_start(time_s: FloatArray) -> tuple[FloatArray, str]:
    """Return times for an axis and its label; times since an epoch count from the first."""
    span = float(np.ptp(time_s)) if time_s.size else 0.0
    scale = scaled("s", span)
    if time_s.size and abs(time_s[0]) > 100.0 * max(span, 1e-12):
        return (time_s - time_s[0]) * scale.factor, f"Time from {time_s[0]:.12g} s in {scale.unit}"
    return time_s * scale.factor, f"Time in {scale.unit}"

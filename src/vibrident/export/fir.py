"""Taps that adjust a filter to a target response, by least squares over a band.

With the poles already right, the remaining target is smooth, so a few taps suffice: the error falls like a power of
frequency/rate with their number. Small weights outside the band limit the gain there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray

Response = Callable[[FloatArray], np.ndarray]
TAPS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 24, 32, 48, 64, 96)


@dataclass(frozen=True, eq=False)
class Taps:
    """y_k = Σ_m h_m x_{k − lead − m}."""

    taps: np.ndarray  # h
    lead: int  # whole samples of delay before the first tap
    latency: int  # delay of the target response, samples
    error: float  # largest relative error over the band

    def response(self, frequency_hz: FloatArray, interval_s: float) -> np.ndarray:
        """Response to e^{jωt} sampled."""
        return response_of(self.taps, self.lead, frequency_hz, interval_s)


def response_of(taps: np.ndarray, lead: int, frequency_hz: FloatArray, interval_s: float) -> np.ndarray:
    """Σ_m h_m z^{−lead−m}."""
    turn = -2j * np.pi * np.asarray(frequency_hz) * interval_s
    return np.exp(np.multiply.outer(turn, lead + np.arange(len(taps)))) @ taps


def fitted(
    wanted: Response,
    base: Response,
    band_hz: tuple[float, float],
    rate_hz: float,
    *,
    shift: float,
    tolerance: float,
    outside: float,
    size: float,
    fewest: int = 1,
) -> Taps:
    """The fewest taps with base · taps = wanted · z^{−latency} over the band within ``tolerance``, or the best found.

    Args:
        wanted: target response without latency.
        base: response of the recursive part.
        band_hz: lowest and highest frequency.
        rate_hz: sampling rate.
        shift: approximate delay of wanted/base in samples; sets the latency for a number of taps.
        tolerance: largest relative error.
        outside: weight of the response above the band, relative to its largest value in it.
        size: weight of the taps' size, to which rounding is proportional.
        fewest: least number of taps.
    """
    best: Taps | None = None
    for count in (count for count in TAPS if count >= fewest):
        latency = max(0, int(np.ceil(0.5 * (count - 1) - shift - 1e-9)))
        lead = max(0, int(np.round(shift + latency - 0.5 * (count - 1))))
        h, error = _fit(wanted, base, band_hz, rate_hz, lead + np.arange(count), latency, outside, size)
        if best is None or error < 0.5 * best.error:
            best = Taps(h, lead, latency, error)
        if best.error <= tolerance:
            break
    assert best is not None
    return best


def _fit(
    wanted: Response,
    base: Response,
    band_hz: tuple[float, float],
    rate_hz: float,
    order: np.ndarray,
    latency: int,
    outside: float,
    size: float,
) -> tuple[np.ndarray, float]:
    """Taps at these delays, and their largest relative error over the band."""
    (low, high), taps, points = band_hz, len(order), 3 * len(order) + 40
    # Dense towards both ends, as a polynomial needs it.
    inside = low + (high - low) * 0.5 * (1.0 - np.cos(np.pi * (np.arange(points) + 0.5) / points))
    inside = np.concatenate([inside, np.geomspace(low, high, 40), [low, high]])
    top, ts = 0.5 * rate_hz, 1.0 / rate_hz
    above = np.linspace(min(high * 1.5, 0.5 * (high + top)), top, points)

    def columns(f: FloatArray) -> np.ndarray:
        return base(f)[:, None] * np.exp(np.multiply.outer(-2j * np.pi * f * ts, order))

    target = wanted(inside) * np.exp(-2j * np.pi * inside * latency * ts)
    largest = float(np.max(np.abs(target)))
    own = columns(inside) / target[:, None]
    plain = size * float(np.max(np.abs(own))) * np.eye(taps)
    rows = np.concatenate([own, outside / largest * columns(above), plain])
    right = np.concatenate([np.ones(len(inside)), np.zeros(len(above) + taps)])
    matrix = np.concatenate([rows.real, rows.imag])
    h = np.linalg.lstsq(matrix, np.concatenate([right, np.zeros(len(right))]), rcond=1e-15)[0]
    return h, float(np.max(np.abs(rows[: len(inside)] @ h - 1.0)))

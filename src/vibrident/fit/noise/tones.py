"""Tones in residuals that no motion causes: hum of the mains."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.averages import windowed
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A bin this many times above its surroundings is a tone.
TONE_RATIO = 25.0
#: The most tones of a record that are looked for.
MAX_TONES = 16


def tones_of(
    residual: ComplexArray, noise: ComplexArray, level: FloatArray, moved: BoolArray
) -> tuple[tuple[float, ...], ...]:
    """Return the places, in bins, of tones so strong that their leakage hides others.

    Args:
        residual: shape (R, K).
        noise: what of it is locally incoherent with the motion, shape (R, K).
        level: power of noise around, shape (R, K).
        moved: where the motion has a line of its own, shape (R, K).

    Returns:
        Of each record, the strongest first.
    """
    power = power_of(windowed(residual))
    peak = power[:, 1:-1] > TONE_RATIO * level[:, 2:-2]
    records = np.flatnonzero(np.any(peak, axis=1))
    places: list[tuple[float, ...]] = [()] * len(residual)
    for record in records:
        row = power[record]
        peaks = peak[record] & (row[1:-1] >= row[:-2]) & (row[1:-1] > row[2:])
        peaks &= ~moved[record, 2:-2]
        apart = power_of(windowed(noise[record : record + 1]))[0, 1:-1]
        peaks &= apart > TONE_RATIO * level[record, 2:-2]
        tops = np.flatnonzero(peaks) + 1
        tops = tops[np.argsort(-row[tops])][:MAX_TONES]
        places[record] = tuple((tops + 1 + _offsets(row, tops)).tolist())
    return tuple(places)


def _offsets(power: FloatArray, tops: FloatArray) -> FloatArray:
    """Return where between bins tones are, as Hann's window has it: −½ … ½.

    A parabola would be off by up to two hundredths of a bin.
    """
    low, middle, high = (np.sqrt(power[tops + shift]) for shift in (-1, 0, 1))
    beside = np.maximum(low, high) / middle
    offset = np.clip((2.0 * beside - 1.0) / (1.0 + beside), 0.0, 0.5)
    return np.where(high > low, offset, -offset)

"""Tones in residuals that no motion causes: hum of the mains."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.averages import windowed
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A bin this many times above its surroundings is a tone.
TONE_RATIO = 25.0
#: The most tones of a record that are looked for.
MAX_TONES = 16
#: Tones nearer than so many bins are one: a record as long as this tells no nearer ones apart.
MIN_APART = 1.0


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
    # Under the window a bin is at most (1/4 + 1/2 + 1/4)² / 0.375 times the largest of three.
    strong = np.any(power_of(residual) > 0.375 * TONE_RATIO * level, axis=1)
    places: list[tuple[float, ...]] = [()] * len(residual)
    for record in np.flatnonzero(strong):
        power, apart = power_of(windowed(np.stack([residual[record], noise[record]])))
        least = TONE_RATIO * level[record, 2:-2]
        peaks = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])
        peaks &= np.minimum(power, apart)[1:-1] > least
        peaks &= ~moved[record, 2:-2]
        tops = np.flatnonzero(peaks) + 1
        tops = tops[np.argsort(-power[tops])][:MAX_TONES]
        places[record] = tuple((tops + 1 + _offsets(power, tops)).tolist())
    return tuple(places)


def with_tones(known: tuple[float, ...], found: tuple[float, ...]) -> tuple[float, ...]:
    """Return known tones and those found beside them, in bins; what is left near a known one is no other."""
    fresh = (tone for tone in found if all(abs(tone - other) >= MIN_APART for other in known))
    return (*known, *fresh)[:MAX_TONES]


def _offsets(power: FloatArray, tops: NDArray[np.int_]) -> FloatArray:
    """Return where between bins tones are, as Hann's window has it: −½ … ½.

    A parabola would be off by up to two hundredths of a bin.
    """
    low, middle, high = (np.sqrt(power[tops + shift]) for shift in (-1, 0, 1))
    beside = np.maximum(low, high) / middle
    offset = np.clip((2.0 * beside - 1.0) / (1.0 + beside), 0.0, 0.5)
    return np.where(high > low, offset, -offset)

"""The acceleration of a displacement, within a band: second differences and a filter that makes them derivatives.

A shock or a sweep ends elsewhere than it began, often still moving: its displacement is a ramp, which spoils a
spectrum; its acceleration is not. The second difference has the response (2 sin ½ω)² exactly; the filter beside it has
(½ω / sin ½ω)², to 5e-6 up to 0.35 of the sampling rate, to 1e-3 up to 0.4, and zero at half.
"""

from __future__ import annotations

import functools

import numpy as np
from scipy import signal

from vibrident.interferometer.decimation import ATTENUATION_DB, PASS
from vibrident.interferometer.setting import BoolArray, FloatArray

#: Half the filter's length, by Kaiser's formula for a transition from 0.4 to 0.5 of the rate.
HALF_FILTER = int(np.ceil(0.5 * (ATTENUATION_DB - 7.95) / (2.285 * 2.0 * np.pi * 0.1)))
LOST = HALF_FILTER + 1  # samples lost at either end


@functools.cache
def _filter() -> FloatArray:
    """The filter's coefficients, shape (2 · HALF_FILTER + 1,), symmetric."""
    points = 1 << 14
    frequency = np.arange(points // 2 + 1) / points  # of the rate
    half = np.pi * frequency
    wanted = np.divide(half, np.sin(half), out=np.ones(half.shape), where=half > 0.0) ** 2
    inside = frequency <= 0.5 * (PASS + 0.5)
    window = np.kaiser(2 * HALF_FILTER + 1, signal.kaiser_beta(ATTENUATION_DB))
    asked = wanted.copy()
    for _ in range(8):  # the window smooths the target, so the target is raised where it is curved
        impulse = np.roll(np.fft.irfft(asked * inside, points), HALF_FILTER)[: 2 * HALF_FILTER + 1] * window
        given = np.real(np.fft.rfft(np.roll(np.pad(impulse, (0, points - impulse.size)), -HALF_FILTER)))
        asked += np.where(frequency <= PASS, wanted - given, 0.0)
    return np.asarray(impulse)


def accelerated(displacement: FloatArray, valid: BoolArray, rate_hz: float) -> tuple[FloatArray, BoolArray]:
    """Acceleration and its validity, both ``LOST`` samples shorter at either end.

    ``displacement``: shape (n,), m; ``valid``: shape (n,).
    """
    second = np.diff(displacement, 2) * rate_hz**2
    bad = np.convolve(~valid, np.ones(2 * LOST + 1), "valid") > 0.5
    return np.convolve(second, _filter(), "valid"), ~bad

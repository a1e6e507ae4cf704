"""Slow motion beside a sine that is not the sensor's: of the optical table, of the carrier, of the air.

It is far larger in displacement than in acceleration, and its ends leak into the sine. Motion below a third of the
sine's frequency is removed in a few rounds with the fitted sine, which is the joint fit of both.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from vibrident.interferometer.setting import BoolArray, FloatArray
from vibrident.interferometer.sine import Sine, fit_sine

#: Part of the sine's frequency below which motion is slow.
SLOW = 1.0 / 3.0
#: Rounds of the joint fit.
ROUNDS = 4


def without_slow_motion(
    values: FloatArray, valid: BoolArray, rate_hz: float, near_hz: float | None
) -> tuple[FloatArray, Sine | None]:
    """The values without slow motion, and the sine in them; None for less than a period.

    Args:
        values: shape (n,).
        valid: shape (n,).
        rate_hz: samples per second.
        near_hz: approximate frequency of the sine.
    """
    found = fit_sine(values, valid, rate_hz, near_hz)
    if found is None:
        return values, None
    index = np.arange(values.shape[0])
    known = np.flatnonzero(valid)
    time = index / rate_hz
    slow = np.zeros(values.shape)
    for _ in range(ROUNDS):
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
    return values - slow + np.mean(slow[valid]), found

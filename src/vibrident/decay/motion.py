"""The free motion of a damped oscillator, at any damping.

    y(t) = e^{-δ ωn t} (a cosh μt + b ωn sinh(μt)/μ),   μ² = ωn² (δ² − 1)

Every output of a linear second-order sensor moves like this when nothing drives it: displacement or velocity pickup,
delayed or averaged. Both functions depend on μ² alone, so they pass smoothly from oscillation (μ imaginary) to two real
poles. The gain only scales a and b.
"""

from __future__ import annotations

import numpy as np

from vibrident.records import FloatArray

STEP = 1e-5  # step of the central differences in (ln fn, δ): error and rounding are below 1e-9 of the motion
MOST_GROWTH = 300.0  # exponent of a motion that grows, as a fit may try on its way


def free_motion(natural_frequency_hz: float, damping_ratio: float, time_s: FloatArray) -> FloatArray:
    """The two functions that span the free motion, shape (samples, 2).

    ``natural_frequency_hz``: of the undamped oscillator; ``damping_ratio``: any; slightly negative values are what a
    fit passes on its way; ``time_s``: from the beginning of the motion, shape (samples,).
    """
    angle = 2.0 * np.pi * natural_frequency_hz * np.asarray(time_s, dtype=float)
    square = damping_ratio**2 - 1.0
    if square < 0.0:
        envelope = np.exp(np.minimum(-damping_ratio * angle, MOST_GROWTH))
        turned = np.sqrt(-square) * angle
        return np.stack([envelope * np.cos(turned), envelope * angle * np.sinc(turned / np.pi)], axis=1)
    slow = np.exp(-(damping_ratio - np.sqrt(square)) * angle)
    twice = 2.0 * np.sqrt(square) * angle
    ratio = np.where(twice > 0, -np.expm1(-twice) / np.where(twice > 0, twice, 1.0), 1.0)
    return np.stack([0.5 * slow * (1.0 + np.exp(-twice)), slow * angle * ratio], axis=1)


def motion_slopes(natural_frequency_hz: float, damping_ratio: float, time_s: FloatArray) -> FloatArray:
    """Derivatives of :func:`free_motion` by (ln fn, δ), shape (2, samples, 2), by central differences."""
    up, down = np.exp(STEP), np.exp(-STEP)
    by_frequency = free_motion(natural_frequency_hz * up, damping_ratio, time_s) - free_motion(
        natural_frequency_hz * down, damping_ratio, time_s
    )
    by_damping = free_motion(natural_frequency_hz, damping_ratio + STEP, time_s) - free_motion(
        natural_frequency_hz, damping_ratio - STEP, time_s
    )
    return np.stack([by_frequency, by_damping]) / (2.0 * STEP)

"""A second mode in a free decay: what one linear oscillator leaves, two may explain.

Each oscillator is fitted beside the other, whose motion is among the unknowns, in turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.amounts import plain
from vibrident.fit.decay.motion import DecayFit, Stretch, fit
from vibrident.fit.response.transform import hann

#: Fits of both oscillators in turn, until the cost falls by less than MIN_FALL.
MAX_ROUNDS = 20
MIN_FALL = 1e-3


@dataclass(frozen=True)
class SecondMode:
    """Second mode of a decay.

    Attributes:
        record: name of the record.
        frequency_hz: natural frequencies of the first and the second mode.
        damping: their damping ratios.
    """

    record: str
    frequency_hz: tuple[float, float]
    damping: tuple[float, float]

    @property
    def words(self) -> str:
        """Return the sentence on the mode."""
        first_hz, second_hz = (plain(value, 5) for value in self.frequency_hz)
        first, second = (plain(value, 3) for value in self.damping)
        return (
            f"Two linear modes explain {self.record}: {first_hz} Hz with damping ratio {first}, "
            f"and {second_hz} Hz with {second}."
        )


def with_second_mode(decay: DecayFit) -> tuple[DecayFit, SecondMode] | None:
    """Return the fit of one decay beside a second mode, or None of no mode apart from the first.

    Modes that are nearer to each other than their half bandwidths stand in for damping or a spring
    that depends on the amplitude.
    """
    stretch = decay.stretches[0]
    first = decay
    second = fit([_with_motion_of(stretch, decay)], _loudest_hz(decay), decay.values[1])
    for _ in range(MAX_ROUNDS):
        before = second.cost
        first = fit([_with_motion_of(stretch, second)], *first.values)
        second = fit([_with_motion_of(stretch, first)], *second.values)
        if before - second.cost < MIN_FALL:
            break
    frequencies, dampings = zip(first.values, second.values, strict=True)
    half_widths = sum(f * damping for f, damping in zip(frequencies, dampings, strict=True))
    if abs(frequencies[1] - frequencies[0]) < half_widths or max(dampings) >= 1.0:
        return None
    return first, SecondMode(stretch.name, frequencies, dampings)


def _with_motion_of(stretch: Stretch, oscillator: DecayFit) -> Stretch:
    """Return a stretch with the motion of an oscillator among its unknowns."""
    frequency_hz, damping = oscillator.values
    damping = min(abs(damping), 1.0)
    pole = 2.0 * math.pi * frequency_hz * complex(-damping, math.sqrt(1.0 - damping**2))
    return replace(stretch, channel_poles=(*stretch.channel_poles, pole))


def _loudest_hz(decay: DecayFit) -> float:
    """Return the frequency at which the decay's residual is largest."""
    stretch = decay.stretches[0]
    residual = stretch.response - decay.predicted(0)
    residual = np.where(stretch.valid, residual, 0.0)
    # The second half of a Hann window: the motion is largest at the begin.
    window = hann(2 * residual.size)[residual.size :]
    size = np.abs(np.fft.rfft(residual * window))
    return max(1, int(np.argmax(size[1:])) + 1) * stretch.rate_hz / residual.size

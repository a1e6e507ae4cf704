"""Noise of a signal beside its motion in blocks of bins: a ringing sensor is neither noise nor a tone."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.fit.noise.local import SmoothColumns

SAMPLES = 2000
TIME = np.arange(SAMPLES)


def blocks_of(signal, rng):
    """Noise of the blocks of a signal beside an unrelated motion, over its truth for noise of one, and which ring."""
    motion = np.fft.rfft(rng.standard_normal(SAMPLES))[None]
    response = np.fft.rfft(signal)[None]
    columns = SmoothColumns.from_motions([motion], response.shape, 1.0)
    level, ringing = columns.incoherent_level(response, may_ring=True)
    return level[0] / SAMPLES, ringing[0]


def ringing(rng, size=300.0):
    return size * np.exp(-0.006 * TIME) * np.cos(0.7 * TIME + rng.uniform(0.0, 2.0 * np.pi))


def tone(rng, size=10.0):
    return size * np.cos(0.7748 * TIME + rng.uniform(0.0, 2.0 * np.pi))


def late_pulse(rng, size=300.0):
    """A pulse whose transform turns once in 25 to 60 bins."""
    return size * np.exp(-0.5 * ((TIME - rng.uniform(33.0, 80.0)) / 2.5) ** 2)


def nothing(rng):
    return np.zeros(SAMPLES)


@pytest.mark.parametrize("signal", [nothing, tone, late_pulse])
def test_neither_noise_nor_a_tone_nor_a_late_pulse_rings(signal, rng):
    found = [blocks_of(rng.standard_normal(SAMPLES) + signal(rng), rng)[1] for _ in range(40)]
    assert np.sum(found) <= 1  # one of a thousand records


def test_the_noise_beside_a_ringing_sensor_is_that_of_its_record(rng):
    """A quadratic left most of a resonance of four bins, which was taken for noise."""
    block = int(0.7 * SAMPLES / (2.0 * np.pi) - 1.0) // 24
    levels = []
    for _ in range(40):
        level, rings = blocks_of(rng.standard_normal(SAMPLES) + ringing(rng), rng)
        assert rings[block]
        levels.append(level[block])
    assert 0.6 < np.mean(levels) < 1.4

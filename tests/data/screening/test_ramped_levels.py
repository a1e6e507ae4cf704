"""A drive that ramps between its levels, as behind an amplifier, is not clipped at the outer ones."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.clipping import find_clipped


def channel(values: np.ndarray) -> ChannelSamples:
    return ChannelSamples(values, np.ones(values.size, dtype=bool))


@pytest.mark.parametrize("levels", [(-2.0, 0.0, 2.0), (-1.0, -0.3, 0.4, 1.0)])
@pytest.mark.parametrize("ramp", [2, 5, 10])
def test_levels_with_ramps_between_are_no_rails(levels: tuple[float, ...], ramp: int) -> None:
    for seed in range(10):
        generator = np.random.default_rng(seed)
        commanded = np.repeat(generator.choice(levels, 200), 400)
        fine = np.convolve(commanded, np.ones(10 * ramp) / (10 * ramp), mode="same")
        flags, _ = find_clipped(channel(np.round(fine[::10], 12)))
        assert not flags.any()


def test_bursts_of_a_clipped_tone_between_rests_are_clipped() -> None:
    time = np.arange(400)
    burst = np.clip(np.sin(0.2137 * time) * np.hanning(400), -0.6, 0.6)
    values = np.tile(np.concatenate([burst, np.zeros(300)]), 10)
    flags, rails = find_clipped(channel(values))
    assert flags.any()
    assert rails == pytest.approx([0.6, -0.6])

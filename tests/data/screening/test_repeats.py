"""Blocks that a recorder wrote twice are found and left out; what repeats by itself is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vibrident.data.records import FloatArray, Record
from vibrident.data.screening import screen
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.repeats import repeated_block
from vibrident.physics.simulation import simulate

N = 1000
T = np.arange(N)
P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}


def recorded(excitation: str, rng: np.random.Generator, bits: int = 0) -> Record:
    shape = {"samples": N, "sampling_rate_hz": 10e3, "response_noise": 1e-3, "seed": int(rng.integers(1000))}
    record = simulate(("accelerometer", P), excitation, **shape).records[0]
    if not bits:
        return record
    step = 2.0 ** (1 - bits) * np.max(np.abs(record.response))
    return replace(record, response=step * np.rint(record.response / step))


def written_twice(values: FloatArray, at: int, length: int) -> FloatArray:
    return np.concatenate([values[: at + length], values[at : at + length], values[at + 2 * length :]])


@pytest.mark.parametrize("excitation", ["sine", "multisine", "random", "sweep"])
@pytest.mark.parametrize("bits", [0, 12])
def test_a_buffer_written_twice_is_found(excitation, bits, rng):
    """Of 40 and 150 samples, in fine and in coarse steps; without it nothing is."""
    for length in (40, 150):
        values = recorded(excitation, rng, bits).response
        assert repeated_block(ChannelSamples(values, np.ones(N, dtype=bool))) is None
        found = repeated_block(ChannelSamples(written_twice(values, 307, length), np.ones(N, dtype=bool)))
        assert found is not None
        assert abs(found.first - 307) <= 2
        assert abs(found.length - length) <= 4
        assert found.second - found.first == length


def periodic(kind: str, rng: np.random.Generator) -> FloatArray:
    if kind == "sine":
        return np.sin(2.0 * np.pi * rng.integers(5, 40) / 200.0 * T + rng.uniform(0.0, 6.3))
    if kind == "beating":
        return sum(np.sin(2.0 * np.pi * rng.uniform(0.01, 0.2) * T) for _ in range(3))
    if kind == "two shocks":
        return sum(np.exp(-(((T - at) / 20.0) ** 2)) for at in (250, 700))
    if kind == "chips":
        return np.repeat(rng.choice([-1.0, 1.0], N // 5), 5)
    return np.tile(rng.standard_normal(N // 2), 2)


@pytest.mark.parametrize("kind", ["sine", "beating", "two shocks", "chips", "one period after the other"])
@pytest.mark.parametrize("bits", [0, 7, 10])
def test_a_motion_that_repeats_itself_is_no_fault(kind, bits, rng):
    """Without any noise, 20 times each: a generator's own samples."""
    for _ in range(20):
        values = periodic(kind, rng)
        if bits:
            values = np.rint(2.0 ** (bits - 1) * values / np.max(np.abs(values)))
        assert repeated_block(ChannelSamples(values, np.ones(N, dtype=bool))) is None


@pytest.mark.parametrize(("channel", "code"), [("response", "dead_channel"), ("both", "clock_suspect")])
def test_the_copy_is_left_out_and_named(channel, code, rng):
    """A channel's copy alone; of both channels of a steady motion all but the longest part, as time was lost."""
    record = recorded("random", rng)
    changed = {"response": written_twice(record.response, 300, 64)}
    if channel == "both":
        changed["reference"] = written_twice(record.reference, 300, 64)
    (kept,), findings = screen([replace(record, **changed)])
    assert [finding.code for finding in findings] == [code]
    assert "buffer twice" in findings[0].message
    assert not kept.mask[364:428].any()
    assert kept.reference_mask[364:428].all() == (channel == "response")
    assert kept.mask[300:360].any() == (channel == "response")

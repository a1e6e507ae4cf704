"""Wild samples: bursts of 2 to 40 in a row, and single glitches, in one channel or in both."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np

from bench.adversary.defects import Raw
from bench.adversary.draws import (
    describe,
    draw_noise,
    draw_records,
    draw_setting,
    faulty_trial,
    level,
    log_uniform,
)
from bench.adversary.trial import Cases, Trial

LENGTHS = {"single": (1, 1), "2 to 5": (2, 5), "6 to 12": (6, 12), "13 to 40": (13, 40)}
CHANNELS = {
    "response": ("response",),
    "reference": ("reference",),
    "both": ("reference", "response"),
}
MOTIONS = ("random", "sweep running", "multisine")
QUANTITIES = ("acceleration", "acceleration", "velocity")


def cases() -> Cases:
    """Return the names and makers."""
    for length, channel, motion in itertools.product(LENGTHS, CHANNELS, MOTIONS):
        yield f"{length}/{channel}/{motion}", partial(_maker, length, channel, motion)


def _maker(length: str, channel: str, motion: str, rng: np.random.Generator) -> Trial:
    quantity = str(rng.choice(QUANTITIES))
    places = ("in", "edge", "above")
    conditions, drawn = draw_setting("accelerometer", quantity, rng, places, ("light", "damped"))
    noise = draw_noise(rng, (1e-4, 1e-1))
    shape = ((1, 12_000), (1, 30_000), (4, 2500))[rng.integers(3)]
    sound = draw_records(motion, conditions, noise, rng, shape)
    bursts = int(rng.integers(1, 4))
    size = log_uniform(1.0, 600.0, rng)
    recordings = [sound[0]]
    for _ in range(bursts):
        recordings[0] = spoiled(recordings[0], CHANNELS[channel], LENGTHS[length], size, rng)
    recordings += sound[1:]
    text = f"{bursts} of {size:.3g} rms; {describe(conditions, recordings, noise, drawn)}"
    return faulty_trial(recordings, sound, conditions, "wild samples", text, compared=True)


def spoiled(
    raw: Raw,
    channels: tuple[str, ...],
    length: tuple[int, int],
    size: float,
    rng: np.random.Generator,
) -> Raw:
    """Return the recording with a stretch of samples replaced, or one moved, by anything."""
    count = int(rng.integers(length[0], length[1] + 1))
    begin = int(rng.integers(raw.response.size // 20, raw.response.size * 19 // 20))
    for channel in channels:
        values = getattr(raw, channel).copy()
        reach = size * level(values) * (log_uniform(0.1, 1.0, rng) if len(channels) > 1 else 1.0)
        if count == 1:
            values[begin] += reach * float(rng.choice([-1.0, 1.0]))
        else:
            values[begin : begin + count] = rng.uniform(-reach, reach, count)
        raw = replace(raw, **{channel: values})
    return raw

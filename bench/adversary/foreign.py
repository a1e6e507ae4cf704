"""Recordings that are not of the sensor asked for: nothing stated of them can be true."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from bench.adversary.damaged import NOISES
from bench.adversary.defects import Raw
from bench.adversary.noise import Noise, rms
from bench.adversary.recording import records, setting
from bench.adversary.trial import Cases, Trial, calibration

MOTIONS = ("multisine", "random", "sweep", "shock", "sine")
SENSORS = ("in-light", "below-light", "above-light")
Strange = Callable[[Raw, np.random.Generator], Raw]


def _noise_alone(raw: Raw, rng: np.random.Generator) -> Raw:
    return replace(raw, response=rms(raw.response) * rng.normal(size=raw.response.size))


def _both_noise(raw: Raw, rng: np.random.Generator) -> Raw:
    return replace(
        _noise_alone(raw, rng), reference=rms(raw.reference) * rng.normal(size=raw.reference.size)
    )


def _squared(raw: Raw, rng: np.random.Generator) -> Raw:
    """Return a rectifier: what it answers is even in the motion."""
    return replace(raw, response=np.abs(raw.response))


def _integrated(raw: Raw, rng: np.random.Generator) -> Raw:
    """Return an integrator twice over, of noise beside."""
    return replace(raw, response=np.cumsum(np.cumsum(rng.normal(size=raw.response.size))))


def _reversed(raw: Raw, rng: np.random.Generator) -> Raw:
    """Return a response that runs backwards: no causal sensor has it."""
    return replace(raw, response=raw.response[::-1].copy())


STRANGE: dict[str, Strange] = {
    "noise for the response": _noise_alone,
    "noise for both channels": _both_noise,
    "rectified response": _squared,
    "drifting noise for the response": _integrated,
    "response backwards": _reversed,
}
#: The response of another measurement of the same sensor.
PAIRED = "response of another measurement"
#: Every parameter of an accelerometer; none has a value that is true.
NOTHING_TRUE = dict.fromkeys(("sensitivity", "natural_frequency", "damping_ratio"), np.inf)


def cases() -> Cases:
    """Return the names and makers."""
    turn = itertools.cycle(itertools.product(SENSORS, NOISES))
    for name, motion in itertools.product((*STRANGE, PAIRED), MOTIONS):
        if motion == "sine" and name in (PAIRED, "response backwards", "rectified response"):
            continue  # of steady sines that is a change of phase, or of gain
        for _ in range(2):
            sensor, noise = next(turn)
            if motion == "sweep" and name == PAIRED:
                continue  # one sweep is like another
            yield (
                f"{name}/{motion}/{sensor}/{noise.name}",
                partial(_maker, name, sensor, motion, noise),
            )


def _maker(name: str, sensor: str, motion: str, noise: Noise, rng: np.random.Generator) -> Trial:
    conditions = setting(sensor, rng)
    recordings = records(motion, conditions, noise, rng)
    if name == PAIRED:
        second_recordings = records(motion, conditions, noise, rng)
        recordings = [
            replace(recording, response=second.response)
            for recording, second in zip(recordings, second_recordings, strict=True)
        ]
    else:
        recordings = [STRANGE[name](recording, rng) for recording in recordings]
    model = conditions.sensor.model
    return Trial(
        calibration(recordings, model, conditions.quantity),
        model,
        NOTHING_TRUE,
        cause=name,
        strange=True,
    )

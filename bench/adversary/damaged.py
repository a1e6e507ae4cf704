"""Recordings in which one thing is wrong; the right model is asked for."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np

from bench.adversary import motions
from bench.adversary.clean import readable
from bench.adversary.defects import Defect, Raw, acquisition, recordings
from bench.adversary.noise import Noise
from bench.adversary.physics import Sensor
from bench.adversary.recording import (
    SHAPES,
    Setting,
    excite,
    recorded,
    records,
    setting,
    switched,
    twin,
)
from bench.adversary.trial import Cases, Trial, calibration

SENSORS = (
    "in-light",
    "above-light",
    "in-damped",
    "below-light",
    "edge-light",
    "pickup-in-damped",
    "far-light",
)
MOTIONS = ("sine", "multisine", "random", "sweep", "shock", "mixed")
NOISES = (
    Noise("0.1 %", 1e-3),
    Noise("1 %", 1e-2),
    Noise("0.01 %", 1e-4),
    Noise("16 bit", 1e-4, bits=16),
)
#: Defects of the sensor itself: name, and what it becomes in the middle of each record.
BECOMES = {
    "regime of damping:2": {"damping_ratio": 2.0},
    "regime of damping:1.1": {"damping_ratio": 1.1},
    "regime of damping:10": {"damping_ratio": 10.0},
    "regime of frequency:1.01": {"natural_frequency": 1.01},
    "regime of frequency:1.1": {"natural_frequency": 1.1},
}
ANOTHER = {
    "another sensor in one record:fn 1.02": {"natural_frequency": 1.02},
    "another sensor in one record:fn 1.3": {"natural_frequency": 1.3},
    "another sensor in one record:damping 3": {"damping_ratio": 3.0},
    "timing of one record:0.3": {"delay": 0.3},
    "timing of one record:3": {"delay": 3.0},
}


def cases() -> Cases:
    """Return the names and makers."""
    turn = itertools.cycle(itertools.product(SENSORS, NOISES))
    for defect, motion in itertools.product(recordings(), (*MOTIONS, "sine", "random")):
        if "stated frequency" in defect.name and motion != "sine":
            continue
        sensor, noise = next(turn)
        yield (
            f"{defect.name}/{motion}/{sensor}/{noise.name}",
            partial(_maker, sensor, motion, noise, defect),
        )
    for (name, factors), motion in itertools.product(BECOMES.items(), MOTIONS[:5]):
        sensor = "in-light" if "frequency" in name or motion != "random" else "in-damped"
        noise = next(turn)[1]
        yield (
            f"{name}/{motion}/{sensor}/{noise.name}",
            partial(_becoming, name, factors, sensor, motion, noise),
        )
    for (name, factors), motion in itertools.product(ANOTHER.items(), MOTIONS):
        noise = next(turn)[1]
        yield (
            f"{name}/{motion}/in-light/{noise.name}",
            partial(_another, name, factors, motion, noise),
        )
    for quantities, motion in itertools.product(MISTAKEN, MOTIONS):
        sensor, noise = next(turn)
        name = f"reference mistaken:{quantities[0]} for {quantities[1]}"
        yield (
            f"{name}/{motion}/{sensor}/{noise.name}",
            partial(_mistaken, name, quantities, sensor, motion, noise),
        )
    for rest_fraction, noise in itertools.product((0.3, 0.6), NOISES):
        yield (
            f"rest in sines:{rest_fraction:g}/sine/in-light/{noise.name}",
            partial(_resting, rest_fraction, noise),
        )
    for defect, motion in itertools.product(acquisition(), MOTIONS):
        sensor, noise = next(turn)
        yield (
            f"{defect.name}/{motion}/{sensor}/{noise.name}",
            partial(_maker, sensor, motion, noise, defect),
        )


MISTAKEN = (
    ("velocity", "acceleration"),
    ("acceleration", "velocity"),
    ("displacement", "acceleration"),
    ("acceleration", "displacement"),
)


def _trial(
    recordings: list[Raw], conditions: Setting, defect: Defect | str, sound: list[Raw] | None = None
) -> Trial:
    cause = defect.split(":")[0] if isinstance(defect, str) else defect.cause
    without = None
    if sound is not None:
        without = calibration(sound, conditions.sensor.model, conditions.quantity)
    return Trial.from_recordings(
        recordings, conditions.sensor, conditions.quantity, cause=cause, sound=without
    )


def _maker(
    sensor: str, motion: str, noise: Noise, defect: Defect, rng: np.random.Generator
) -> Trial:
    conditions = setting(sensor, rng)
    if noise.bits:
        conditions = readable(conditions)
    recordings = records(motion, conditions, noise, rng, stated="stated" in defect.name)
    return _trial(defect.change(recordings, rng), conditions, defect, recordings)


def _becoming(
    name: str,
    factors: dict[str, float],
    sensor: str,
    motion: str,
    noise: Noise,
    rng: np.random.Generator,
) -> Trial:
    conditions = setting(sensor, rng)
    second_sensor = twin(conditions.sensor, **factors)
    samples = SHAPES[motion][1]
    t = np.arange(samples) / conditions.rate
    at = t[-1] * rng.uniform(0.4, 0.6)
    recordings = []
    for i, move in enumerate(excite(motion, conditions, rng)):
        response = switched(move, conditions.sensor, second_sensor, at, t)
        reference, response = recorded(
            move.reference(t, conditions.quantity), response, conditions.rate, noise, rng
        )
        recordings.append(Raw(f"{motion}-{i}", reference, response, conditions.rate, motion))
    return _trial(recordings, conditions, name)


def _another(
    name: str, factors: dict[str, float], motion: str, noise: Noise, rng: np.random.Generator
) -> Trial:
    conditions = setting("in-light", rng)
    of_changed = replace(
        conditions, sensor=_changed_sensor(conditions.sensor, factors, conditions.rate)
    )
    seed = int(rng.integers(2**31))
    from_sensor, strange = (
        records(motion, g, noise, np.random.default_rng(seed)) for g in (conditions, of_changed)
    )
    at = int(rng.integers(len(from_sensor)))
    return _trial(
        [*from_sensor[:at], strange[at], *from_sensor[at + 1 :]], conditions, name, from_sensor
    )


def _changed_sensor(sensor: Sensor, factors: dict[str, float], rate: float) -> Sensor:
    late = {"delay": factors["delay"] / rate} if "delay" in factors else {}
    return replace(
        twin(sensor, **factors), parameters={**twin(sensor, **factors).parameters, **late}
    )


def _mistaken(
    name: str,
    quantities: tuple[str, str],
    sensor: str,
    motion: str,
    noise: Noise,
    rng: np.random.Generator,
) -> Trial:
    conditions = replace(setting(sensor, rng), quantity=quantities[0])
    recordings = records(motion, conditions, noise, rng)
    return _trial(recordings, replace(conditions, quantity=quantities[1]), name)


def _resting(rest_fraction: float, noise: Noise, rng: np.random.Generator) -> Trial:
    """Sines that begin late in their record."""
    conditions = setting("in-light", rng)
    count, samples = SHAPES["sine"]
    t = np.arange(samples) / conditions.rate
    recordings = []
    for i, tone in enumerate(excite("sine", conditions, rng)):
        move = motions.gated(tone, samples, conditions.rate, rest_fraction)
        channels = move.reference(t, conditions.quantity), move.response(conditions.sensor, t)
        recordings.append(
            Raw(
                f"sine-{i} of {count}",
                *recorded(*channels, conditions.rate, noise, rng),
                conditions.rate,
                "sine",
            )
        )
    return _trial(recordings, conditions, "rest in sines")

"""Several things are wrong at once: two or three defects of the recordings, one after the other."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np

from bench.adversary.clean import readable
from bench.adversary.damaged import MOTIONS, NOISES, SENSORS
from bench.adversary.defects import Defect, recordings
from bench.adversary.noise import Noise
from bench.adversary.recording import records, setting
from bench.adversary.trial import Cases, Trial, calibration

#: Of each number of defects.
CASES = {2: 60, 3: 30}


def cases() -> Cases:
    """Return the names and makers."""
    kinds = sorted(
        (defect for defect in recordings() if "stated" not in defect.name),
        key=lambda defect: defect.name,
    )
    turn = itertools.cycle(itertools.product(SENSORS, NOISES))
    chosen = np.random.default_rng(26)
    for count, number in CASES.items():
        for index, motion in zip(range(number), itertools.cycle(MOTIONS)):
            defects = [
                kinds[kind]
                for kind in sorted(chosen.choice(len(kinds), count, replace=False).tolist())
            ]
            sensor, noise = next(turn)
            names = " + ".join(defect.name for defect in defects)
            name = f"{count} defects/{index}/{names}/{motion}/{sensor}/{noise.name}"
            yield name, partial(_maker, sensor, motion, noise, defects)


def _maker(
    sensor: str, motion: str, noise: Noise, defects: list[Defect], rng: np.random.Generator
) -> Trial:
    conditions = setting(sensor, rng)
    if noise.bits:
        conditions = readable(conditions)
    recordings = sound = records(motion, conditions, noise, rng)
    for defect in defects:
        recordings = defect.change(recordings, rng)
    cause = f"{len(defects)} defects at once"
    without = calibration(sound, conditions.sensor.model, conditions.quantity)
    return Trial.from_recordings(
        recordings, conditions.sensor, conditions.quantity, cause=cause, sound=without
    )

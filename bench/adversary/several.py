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
        (one for one in recordings() if "stated" not in one.name), key=lambda one: one.name
    )
    turn = itertools.cycle(itertools.product(SENSORS, NOISES))
    chosen = np.random.default_rng(26)
    for count, number in CASES.items():
        for index, motion in zip(range(number), itertools.cycle(MOTIONS)):
            defects = [
                kinds[place]
                for place in sorted(chosen.choice(len(kinds), count, replace=False).tolist())
            ]
            sensor, noise = next(turn)
            names = " + ".join(defect.name for defect in defects)
            name = f"{count} defects/{index}/{names}/{motion}/{sensor}/{noise.name}"
            yield name, partial(_maker, sensor, motion, noise, defects)


def _maker(
    sensor: str, motion: str, noise: Noise, defects: list[Defect], rng: np.random.Generator
) -> Trial:
    given = setting(sensor, rng)
    if noise.bits:
        given = readable(given)
    made = sound = records(motion, given, noise, rng)
    for defect in defects:
        made = defect.change(made, rng)
    cause = f"{len(defects)} defects at once"
    without = calibration(sound, given.sensor.model, given.quantity)
    return Trial.from_recordings(made, given.sensor, given.quantity, cause=cause, sound=without)

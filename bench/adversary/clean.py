"""Clean recordings: sensors, motions and noise of every kind; the right model is asked for."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np

from bench.adversary.noise import Noise
from bench.adversary.recording import Setting, records, setting
from bench.adversary.trial import Cases, Trial, calibration, truth

NOISES = (
    Noise("white 0.1 %", 1e-3),
    Noise("white 1 %", 1e-2),
    Noise("white 1e-6", 1e-6),
    Noise("1/f 0.3 %", 3e-3, colour="pink"),
    Noise("growing 0.5 %", 5e-3, colour="growing"),
    Noise("hum 1 %", 1e-3, hum=0.01),
    Noise("hum 0.1 %", 1e-3, hum=0.001),
    Noise("reference 0.1 %", 1e-3, reference=1e-3),
    Noise("reference 1 %", 1e-3, reference=1e-2),
    Noise("felt 5 %", 1e-3, felt=0.05),
    Noise("16 bit", 1e-5, bits=16),
    Noise("8 bit", 1e-4, bits=8),
    Noise("12 bit", 1e-5, bits=12),
    Noise("24 bit", 1e-6, bits=24),
)
SENSORS = (
    "below-light",
    "below-damped",
    "in-sharp",
    "in-light",
    "in-damped",
    "in-over",
    "edge-sharp",
    "edge-light",
    "edge-damped",
    "above-sharp",
    "above-light",
    "above-damped",
    "far-light",
    "in-light+delay",
    "above-light+delay",
    "in-damped+delay",
    "in-light+delay=40",
    "below-light+delay=300",
    "in-damped+highpass",
    "above-light+highpass",
    "in-light+mode2=0.03",
    "in-light+mode2=-0.1",
    "in-light+mode2=0.3",
    "above-light+mode2=0.01",
    "pickup-below-damped",
    "pickup-in-light",
    "pickup-below-over",
    "pickup-below-damped+delay",
    "pickup-in-damped+highpass",
)
MOTIONS = ("sine", "multisine", "random", "sweep", "shock", "burst", "mixed")
#: Sines of a laboratory's bench: in step with the recorder, and begun while it runs.
BENCH = {
    "locked": (NOISES[2], *(noise for noise in NOISES if noise.bits)),
    "rung": (NOISES[0], NOISES[2], NOISES[7], NOISES[8]),
}
#: A single record of a few tones, where little is left to judge a model by.
FEW_SENSORS = (
    "in-light",
    "in-damped",
    "above-light",
    "in-light+delay",
    "in-damped+highpass",
    "pickup-below-damped",
)
BENCH_SENSORS = ("in-light", "in-damped", "above-light", "pickup-below-damped")
#: Noises that each sensor and motion are tried with; each takes the next in turn.
NOISES_PER_CASE = 3


def cases() -> Cases:
    """Return the names and makers."""
    turn = itertools.cycle(NOISES)
    for sensor, motion in itertools.product(SENSORS, MOTIONS):
        for _ in range(NOISES_PER_CASE):
            noise = next(turn)
            yield f"{sensor}/{motion}/{noise.name}", partial(_maker, sensor, motion, noise)
    for motion, noises in BENCH.items():
        for sensor, noise in itertools.product(BENCH_SENSORS, noises):
            yield f"{sensor}/{motion}/{noise.name}", partial(_maker, sensor, motion, noise)
    for sensor, noise in itertools.product(FEW_SENSORS, (NOISES[0], NOISES[7])):
        yield f"{sensor}/few tones/{noise.name}", partial(_maker, sensor, "few tones", noise)
    for noise, motion in itertools.product(NOISES, ("sine", "multisine")):
        yield (
            f"far-light+boxcar/{motion}/{noise.name}",
            partial(_maker, "far-light+boxcar", motion, noise),
        )


def readable(conditions: Setting) -> Setting:
    """Return a setting whose reference has little noise or steps of its own over the whole band.

    The displacement of a motion that is level in acceleration falls by 64 dB over the band.
    """
    return replace(
        conditions,
        quantity="velocity" if conditions.quantity == "displacement" else conditions.quantity,
    )


def _maker(sensor: str, motion: str, noise: Noise, rng: np.random.Generator) -> Trial:
    conditions = setting(sensor, rng)
    if motion == "rung":  # a beginning has lines of its own, which stand out of a displacement
        conditions = replace(conditions, quantity="acceleration")
    if motion not in ("sine", "multisine", "few tones", "mixed") and (
        noise.reference or noise.bits
    ):
        conditions = readable(conditions)
    recordings = records(motion, conditions, noise, rng)
    allowed = {"reference_noise"} if noise.reference else set()
    model = conditions.sensor.model
    recordings = calibration(recordings, model, conditions.quantity)
    return Trial(recordings, model, truth(conditions.sensor), allowed=frozenset(allowed))

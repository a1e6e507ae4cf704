"""The sensor has something that the model asked for lacks, or bends."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np

from bench.adversary import motions
from bench.adversary.bent import bent
from bench.adversary.defects import Raw
from bench.adversary.noise import Noise
from bench.adversary.physics import Motion, Sensor
from bench.adversary.recording import SHAPES, Setting, recorded, records, setting
from bench.adversary.trial import Cases, Trial, calibration, truth

LACKS = {
    "delay": ("in-light+delay=1", "in-damped+delay=3", "in-light+delay=30"),
    "highpass": ("in-light+highpass=1", "in-damped+highpass=0.3", "above-light+highpass=2"),
    "mode2": ("in-light+mode2=0.1", "above-light+mode2=0.03", "in-damped+mode2=-0.1"),
    "boxcar": ("far-light+boxcar", "in-light+boxcar"),
}
MOTIONS = ("sine", "multisine", "random", "sweep", "shock", "mixed")
#: What a single record of a few tones must not hide.
HIDDEN = (
    *(("delay", sensor) for sensor in LACKS["delay"]),
    ("highpass", "in-light+highpass=1"),
    ("mode2", "in-light+mode2=0.1"),
    ("boxcar", "in-light+boxcar"),
)
NOISES = (Noise("0.1 %", 1e-3), Noise("1 %", 1e-2))
#: Third harmonic over the fundamental, well below resonance, and rest points as parts of the
#: largest V.
BENDS = (0.001, 0.01, -0.01)
RESTS = {"at zero": (0.0, 0.0), "of the spring": (0.3, 0.3), "of the reference": (0.0, 0.3)}


def cases() -> Cases:
    """Return the names and makers."""
    turn = itertools.cycle(NOISES)
    for lacked, sensors in LACKS.items():
        for sensor, motion in itertools.product(sensors, MOTIONS):
            noise = next(turn)
            yield (
                f"{lacked}/{sensor}/{motion}/{noise.name}",
                partial(_lacking, lacked, sensor, motion, noise),
            )
    for lacked, sensor in HIDDEN:
        yield (
            f"{lacked}/{sensor}/few tones/0.1 %",
            partial(_lacking, lacked, sensor, "few tones", NOISES[0]),
        )
    for bend, rest_position, motion in itertools.product(
        BENDS, RESTS, ("sine", "multisine", "random", "sweep")
    ):
        for model_name in ("accelerometer", "accelerometer+cubic"):
            if model_name == "accelerometer" and rest_position != "at zero":
                continue  # a linear sensor of another natural frequency stands there
            noise = next(turn)
            name = f"spring {bend:g} rest {rest_position}/{motion}/{noise.name}/{model_name}"
            yield name, partial(_bending, bend, rest_position, motion, noise, model_name)


def _lacking(
    lacked: str, sensor: str, motion: str, noise: Noise, rng: np.random.Generator
) -> Trial:
    conditions = setting(sensor, rng)
    recordings = records(motion, conditions, noise, rng)
    model = "+".join(part for part in conditions.sensor.parts if part != lacked)
    true = seen_without_mode2(conditions) if lacked == "mode2" else truth(conditions.sensor)
    return Trial(
        calibration(recordings, model, conditions.quantity),
        model,
        true,
        cause=f"model lacks {lacked}",
    )


def seen_without_mode2(conditions: Setting) -> dict[str, float]:
    """Return the truth on a sensor of two modes as one of one mode.

    Its static sensitivity has both modes' shares.
    """
    parameters = conditions.sensor.parameters
    apparent = truth(conditions.sensor) | {
        "sensitivity": parameters["sensitivity"] * (1.0 + parameters["mode2_gain"])
    }
    return {name: value for name, value in apparent.items() if name != "conversion_coefficient"}


def _bending(
    bend: float,
    rest_position: str,
    motion: str,
    noise: Noise,
    model_name: str,
    rng: np.random.Generator,
) -> Trial:
    """Return springs that harden or soften, with the zero of the reference and their rest point."""
    rate = 2000.0
    samples = SHAPES[motion][1]
    low = 0.005 * rate
    top = 0.1 * rate
    fn = top * rng.uniform(0.3, 0.8)
    parameters = {
        "sensitivity": 1.0,
        "natural_frequency": fn,
        "damping_ratio": rng.uniform(0.25, 0.6),
    }
    recordings = []
    for i, (move, spacing) in enumerate(_periodic(motion, (low, top), samples, rate, rng)):
        sensor = Sensor("accelerometer+cubic", {**parameters, "cubic_stiffness": 0.0})
        t = np.arange(samples) / rate
        level = float(np.max(np.abs(move.response(sensor, t))))
        size = (i % 3 + 1) / 3.0
        move = move.scaled(size / level)  # the largest |V| is about one third, two thirds, one
        sensor = Sensor("accelerometer+cubic", {**parameters, "cubic_stiffness": 4.0 * bend})
        spring, shown = RESTS[rest_position]
        # The recorder couples the response by AC.
        answer = bent(move, sensor, spacing, offset=spring)[0]
        channels = move.acceleration(t) + shown, answer.acceleration(t)
        reference, response = recorded(*channels, rate, noise, rng)
        recordings.append(Raw(f"{motion}-{i}", reference, response, rate, motion))
    true = truth(Sensor("accelerometer+cubic", {**parameters, "cubic_stiffness": 4.0 * bend}))
    cause = "" if model_name.endswith("cubic") else "model lacks cubic"
    if model_name.endswith("cubic") and any(RESTS[rest_position]):
        cause = "rest point of a cubic spring"
    return Trial(calibration(recordings, model_name, "acceleration"), model_name, true, cause=cause)


def _periodic(
    motion: str, band: tuple[float, float], samples: int, rate: float, rng: np.random.Generator
):
    """Motions and the spacing of the lines that their tones lie on."""
    count = SHAPES[motion][0]
    if motion == "sine":
        for frequency in np.geomspace(max(band[0], 3.1 * rate / samples), band[1], count):
            yield motions.sine(float(frequency), 1.0, rng), float(frequency)
        return
    period = int(motions.PERIOD * samples)
    for i in range(count):
        if motion == "multisine":
            lines = np.unique(np.rint(np.geomspace(*band, 15) * period / rate)).astype(int)
            move = motions.multisine(lines * rate / period, 1.0, rng)
        elif motion == "sweep":
            move = motions.sweep(band, 1.0 + i % 3, samples, rate)
        else:
            move = motions.random(band, 1.0, samples, rate, rng)
        yield Motion(move.frequency_hz, move.amplitude), rate / period

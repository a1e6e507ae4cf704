"""Free decays, alone and beside sines."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from bench.adversary.defects import Raw
from bench.adversary.noise import Noise, recorded_channel
from bench.adversary.physics import TAU, Sensor
from bench.adversary.recording import records, setting, twin
from bench.adversary.trial import Cases, Trial, calibration

NOISES = (
    Noise("0.1 %", 1e-3),
    Noise("1 %", 1e-2),
    Noise("1/f 0.5 %", 5e-3, colour="pink"),
    Noise("12 bit", 1e-5, bits=12),
)
SENSORS = ("in-sharp", "in-light", "below-light", "edge-light", "pickup-in-light")
SAMPLES = 2000
DAMPING_GROWTH = (0.1, 1.0)  # damping grows by this much from small motion to the first swing


def cases() -> Cases:
    """Return the names and makers."""
    for sensor, noise, count in itertools.product(SENSORS, NOISES, (1, 4)):
        yield f"alone {count}/{sensor}/{noise.name}", partial(_alone, sensor, noise, count)
    for growth, noise, count in itertools.product(DAMPING_GROWTH, NOISES, (1, 4)):
        yield (
            f"damping grows {growth:g}/{count}/{noise.name}",
            partial(_growing, growth, noise, count),
        )
    for sensor, noise in itertools.product(SENSORS[1:], NOISES):
        yield f"with sines/{sensor}/{noise.name}", partial(_with_sines, sensor, noise, 1.0, 1.0)
    for damping, frequency in ((0.1, 1.0), (0.7, 1.0), (3.0, 1.0), (1.0, 1.05), (1.0, 0.8)):
        for noise in NOISES:
            name = f"another's with sines/damping {damping:g} frequency {frequency:g}/{noise.name}"
            yield name, partial(_with_sines, "in-light", noise, damping, frequency)


def _decay(sensor: Sensor, rate: float, noise: Noise, rng: np.random.Generator, name: str) -> Raw:
    t = np.arange(SAMPLES) / rate
    p = sensor.parameters
    w = TAU * p["natural_frequency"]
    d = p["damping_ratio"]
    wave = np.exp(-d * w * t) * np.cos(w * np.sqrt(1.0 - d * d) * t + TAU * rng.random())
    values = recorded_channel(abs(sensor.gain) * 10.0 ** rng.uniform(-1, 1) * wave, noise, rng)
    return Raw(name, np.zeros(0), values + rng.normal() * np.std(values), rate, "decay")


def _alone(sensor: str, noise: Noise, count: int, rng: np.random.Generator) -> Trial:
    conditions = setting(sensor, rng)
    recordings = [
        _decay(conditions.sensor, conditions.rate, noise, rng, f"decay-{i}") for i in range(count)
    ]
    true = {
        name: conditions.sensor.parameters[name] for name in ("natural_frequency", "damping_ratio")
    }
    return Trial(
        calibration(recordings, conditions.sensor.model, "acceleration"),
        conditions.sensor.model,
        true,
    )


def _growing(growth: float, noise: Noise, count: int, rng: np.random.Generator) -> Trial:
    """V̈ + 2 δ (1 + g V²) ωn V̇ + ωn² V = 0 with V = 1 at first."""
    conditions = setting("in-light", rng)
    p = conditions.sensor.parameters
    w = TAU * p["natural_frequency"]
    d = p["damping_ratio"]

    def slope(_, state):
        return [
            state[1],
            -w * w * state[0] - 2.0 * d * (1.0 + growth * state[0] ** 2) * w * state[1],
        ]

    recordings = []
    for i in range(count):
        t = np.arange(SAMPLES) / conditions.rate
        way = solve_ivp(
            slope, (0.0, t[-1]), [1.0 - 0.2 * i, 0.0], "DOP853", t, rtol=1e-7, atol=1e-9
        )
        recordings.append(
            Raw(
                f"decay-{i}",
                np.zeros(0),
                recorded_channel(way.y[0], noise, rng),
                conditions.rate,
                "decay",
            )
        )
    true = {name: p[name] for name in ("natural_frequency", "damping_ratio")}
    return Trial(
        calibration(recordings, "accelerometer", "acceleration"),
        "accelerometer",
        true,
        cause="damping grows",
    )


def _with_sines(
    sensor: str, noise: Noise, damping: float, frequency: float, rng: np.random.Generator
) -> Trial:
    conditions = setting(sensor, rng)
    second_sensor = twin(conditions.sensor, damping_ratio=damping, natural_frequency=frequency)
    recordings = records("sine", conditions, noise, rng)
    recordings += [
        _decay(second_sensor, conditions.rate, noise, rng, f"decay-{i}") for i in range(2)
    ]
    cause = "" if damping == frequency == 1.0 else "decay of another sensor"
    return Trial.from_recordings(recordings, conditions.sensor, conditions.quantity, cause=cause)

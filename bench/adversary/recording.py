"""Sensors of every kind in a band, and recordings of them, exact but for their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.adversary import motions
from bench.adversary.defects import Raw
from bench.adversary.noise import Noise, added, hum, quantised, rms
from bench.adversary.physics import TAU, Complex, Motion, Real, Sensor

#: Samples a second that there are; all else is set in parts of it.
RATES = (100.0, 512.0, 2_000.0, 10_000.0, 51_200.0, 1e6)
LOWEST_RATIO = 0.005  # lowest frequency of the motion, over the rate
HIGHEST_RATIO = 0.2  # highest frequency of the motion, over the rate
#: Natural frequency over the top of the band.
PLACES = {
    "below": (0.05, 0.15),
    "in": (0.25, 0.7),
    "edge": (0.93, 1.1),
    "above": (2.0, 4.0),
    "far": (10.0, 30.0),
}
DAMPINGS = {"sharp": (0.001, 0.006), "light": (0.01, 0.1), "damped": (0.4, 0.8), "over": (1.2, 3.0)}
#: Records and samples of each: few shapes, since every shape of a model is a program to compile.
SHAPES = {
    "sine": (8, 1000),
    "multisine": (8, 1000),
    "random": (8, 1000),
    "sweep": (8, 1000),
    "shock": (8, 1000),
    "burst": (8, 1000),
    "mixed": (8, 1000),
    "locked": (8, 1000),
    "rung": (8, 1000),
    "few tones": (1, 2000),
}
QUANTITIES = ("acceleration", "acceleration", "velocity", "displacement", "drive")
DECLARED = {
    "burst": "random",
    "locked": "sine",
    "rung": "sine",
    "few tones": "multisine",
}  # what is declared of each motion
FEW_TONES = 5  # tones of a multisine that tells hardly more than the parameters
#: Samples of a period of sines whose generator keeps in step with the recorder.
LOCKED_PERIODS = (5, 6, 8, 10, 16, 25, 50, 125)


@dataclass(frozen=True)
class Setting:
    """Sensor, samples a second, and what the reference gives."""

    sensor: Sensor
    rate: float
    quantity: str
    band_hz: tuple[float, float]


def setting(kind: str, rng: np.random.Generator) -> Setting:
    """Draw a sensor by its kind, ``place-damping`` with add-ons behind "+", within its limits.

    ``in-light+delay`` is an accelerometer; ``pickup-in-light`` a velocity pickup.
    """
    core, *add_ons = kind.split("+")
    pickup = core.startswith("pickup-")
    position, damping = core.removeprefix("pickup-").split("-")
    rate = float(rng.choice(RATES))
    low = LOWEST_RATIO * rate
    top = HIGHEST_RATIO * rate
    frequency = top * rng.uniform(*PLACES[position])
    gain = 10.0 ** rng.uniform(-9.0, 9.0) * float(rng.choice([-1.0, 1.0]))
    parameters = {
        "generator_constant" if pickup else "sensitivity": gain,
        "natural_frequency": frequency,
        "damping_ratio": float(np.exp(rng.uniform(*np.log(DAMPINGS[damping])))),
    }
    model = "velocity-pickup" if pickup else "accelerometer"
    for add_on in add_ons:
        name, _, size = add_on.partition("=")
        model += f"+{name}"
        parameters |= _add_on(name, float(size or 0.0), rate, frequency, low, rng)
    quantity = str(
        rng.choice(QUANTITIES if position == "in" and not add_ons else ["acceleration", "drive"])
    )
    return Setting(Sensor(model, parameters), rate, quantity, (low, top))


def _add_on(
    name: str, size: float, rate: float, frequency: float, low: float, rng: np.random.Generator
) -> dict:
    top = HIGHEST_RATIO * rate
    if name == "delay":
        return {"delay": (size or rng.uniform(0.05, 3.0)) / rate}
    if name == "highpass":
        return {"highpass_frequency": low * (size or rng.uniform(0.2, 2.0))}
    if name == "boxcar":
        return {"boxcar_length": (size or rng.uniform(0.3, 0.9)) / top}
    if name == "mode2":
        second_frequency = rng.uniform(1.5, 2.2) if frequency < 0.5 * top else rng.uniform(0.3, 0.6)
        gain = size or 0.03
        return {
            "mode2_frequency": second_frequency * frequency,
            "mode2_damping": rng.uniform(0.01, 0.05),
            "mode2_gain": gain,
        }
    raise ValueError(name)


def excite(
    motion: str, conditions: Setting, rng: np.random.Generator, shape: tuple[int, int] | None = None
) -> list[Motion]:
    """Return the motions of all records."""
    count, samples = shape or SHAPES[motion]
    low, top = conditions.band_hz
    rate = conditions.rate
    if motion == "sine":
        grid = np.geomspace(max(low, 3.1 * rate / samples), top, count)
        return [motions.sine(f * rng.uniform(0.97, 1.0), 10.0, rng) for f in grid]
    if motion in ("multisine", "few tones"):
        tones = 15 if motion == "multisine" else FEW_TONES
        return [
            motions.multisine(_spread(low, top, tones, rate / samples, rng), 10.0, rng)
            for _ in range(count)
        ]
    if motion == "random":
        return [motions.random((low, top), 10.0, samples, rate, rng) for _ in range(count)]
    if motion == "sweep":
        return [motions.sweep((low, top), 10.0 * (1 + i % 3), samples, rate) for i in range(count)]
    if motion == "shock":
        durations = rng.uniform(1.0, 1.6, count) / (0.35 * top)
        return [
            motions.shock(d, 100.0 * (1 + i % 3), samples, rate) for i, d in enumerate(durations)
        ]
    if motion == "burst":
        moving = [motions.random((low, top), 10.0, samples, rate, rng) for _ in range(count)]
        return [motions.gated(m, samples, rate, 0.45) for m in moving]
    if motion == "locked":
        return [
            motions.sine(rate / period, 10.0 * rng.uniform(0.5, 2.0), rng)
            for period in LOCKED_PERIODS
        ]
    if motion == "rung":
        begun = rng.uniform(0.0, 0.1, count)
        steady = excite("sine", conditions, rng, (count, samples))
        return [motions.gated(m, samples, rate, at) for m, at in zip(steady, begun, strict=True)]
    if motion == "mixed":
        return [
            *excite("sine", conditions, rng, (4, samples)),
            *excite("random", conditions, rng, (count - 4, samples)),
        ]
    raise ValueError(motion)


def _spread(low: float, top: float, count: int, apart: float, rng: np.random.Generator) -> Real:
    """Return the frequencies about evenly in their logarithm, at least three lines apart."""
    tones_hz = np.geomspace(low, top, count) * rng.uniform(0.98, 1.0, count)
    for i in range(1, count):
        tones_hz[i] = max(tones_hz[i], tones_hz[i - 1] + 3.0 * apart)
    return tones_hz


def record(
    motion: Motion,
    name: str,
    declared: str,
    samples: int,
    conditions: Setting,
    noise: Noise,
    rng: np.random.Generator,
    *,
    free: float = 0.0,
    stated: bool = False,
) -> Raw:
    """Return an exact recording with noise and free motion, ``free`` times the response's rms."""
    t = np.arange(samples) / conditions.rate
    if noise.felt:
        ambient = motions.random(
            (0.3 * conditions.band_hz[0], 2.0 * conditions.band_hz[1]),
            1.0,
            samples,
            conditions.rate,
            rng,
        )
        ambient = ambient.scaled(noise.felt * rms(motion.acceleration(t)))
        reference = motion.reference(t, conditions.quantity) + ambient.reference(
            t, conditions.quantity
        )
        response = motion.response(conditions.sensor, t) + ambient.response(conditions.sensor, t)
    else:
        reference = motion.reference(t, conditions.quantity)
        response = motion.response(conditions.sensor, t)
    if free:
        response = response + free_motion(conditions.sensor, free * rms(response), t, rng)
    reference, response = recorded(reference, response, conditions.rate, noise, rng)
    frequency = float(motion.frequency_hz[0]) if stated and declared == "sine" else None
    return Raw(name, reference, response, conditions.rate, declared, frequency)


def free_motion(sensor: Sensor, size: float, time_s: Real, rng: np.random.Generator) -> Real:
    """Return what is left of an earlier motion, of this rms over its first tenth."""
    roots = sensor.poles()
    weights: Complex = rng.normal(size=roots.size) + 1j * rng.normal(size=roots.size)
    motion = sensor.free(weights, time_s)
    return motion * size / max(rms(motion[: max(8, time_s.size // 10)]), 1e-300)


def recorded(
    reference: Real, response: Real, rate: float, noise: Noise, rng: np.random.Generator
) -> tuple[Real, Real]:
    """Return both channels with noise, hum and the steps of their converters."""
    response = added(response, noise.response, noise.colour, rng)
    reference = added(reference, noise.reference, noise.reference_colour, rng)
    if noise.hum:
        response = hum(response, noise.hum, rate, 0.01234 * rate, rng)
    if noise.bits:
        response = quantised(response, noise.bits, 2.0 * float(np.max(np.abs(response))))
        reference = quantised(reference, noise.bits, 2.0 * float(np.max(np.abs(reference))))
    return reference, response


def records(
    motion: str,
    conditions: Setting,
    noise: Noise,
    rng: np.random.Generator,
    *,
    shape: tuple[int, int] | None = None,
    stated: bool = False,
) -> list[Raw]:
    """Return all recordings of a calibration."""
    moves: Sequence[Motion] = excite(motion, conditions, rng, shape)
    samples = (shape or SHAPES[motion])[1]
    tones_hz = []
    for i, move in enumerate(moves):
        declared = DECLARED.get(motion, motion)
        if motion == "mixed":
            declared = "sine" if move.frequency_hz.size == 1 else "random"
        moving = (
            motion != "burst"
            and conditions.sensor.parameters["natural_frequency"] < 0.4 * conditions.rate
        )
        # A recorder lets nothing through above half its rate.
        free = float(rng.choice([0.0, 0.3])) if moving else 0.0
        name = f"{declared}-{i}"
        tones_hz.append(
            record(move, name, declared, samples, conditions, noise, rng, free=free, stated=stated)
        )
    return tones_hz


def switched(
    move: Motion, before_sensor: Sensor, second_frequency: Sensor, at_s: float, time_s: Real
) -> Real:
    """Return the response of a sensor that becomes another one, of as many poles, at a time.

    Its state goes on: the response and its derivative do not jump (accelerometers without add-ons).
    """
    before = move.response(before_sensor, time_s)
    after = move.response(second_frequency, time_s)
    speed = Motion(move.frequency_hz, 1j * TAU * move.frequency_hz * move.amplitude)
    now = np.array([at_s])
    jump = [
        float((m.response(before_sensor, now) - m.response(second_frequency, now))[0])
        for m in (move, speed)
    ]
    roots = second_frequency.poles()
    weights = np.linalg.solve(
        np.vander(roots, 2, increasing=True).T, np.asarray(jump, dtype=complex)
    )
    since = np.maximum(time_s - at_s, 0.0)
    return np.where(time_s < at_s, before, after + second_frequency.free(weights, since))


def twin(sensor: Sensor, **factors: float) -> Sensor:
    """Return the sensor with some parameters times a factor."""
    changed = {name: value * factors.get(name, 1.0) for name, value in sensor.parameters.items()}
    return replace(sensor, parameters=changed)

"""Dry friction in the sensor, and decays that do not decay."""

from __future__ import annotations

import itertools
from functools import partial

import numpy as np
from scipy.linalg import expm

from bench.adversary.defects import Raw
from bench.adversary.draws import (
    describe,
    draw_motions,
    draw_noise,
    draw_setting,
    faulty_trial,
    level,
    log_uniform,
)
from bench.adversary.noise import recorded_channel
from bench.adversary.physics import TAU, Motion, Real, Sensor
from bench.adversary.recording import RATES, Setting, recorded
from bench.adversary.trial import Cases, Trial, calibration

STEPS_PER_SAMPLE = 16  # steps a sample
SIZES = {"0.1 to 1 %": (1e-3, 1e-2), "1 to 10 %": (1e-2, 1e-1)}
MOTIONS = ("random", "sweep running", "sweep", "multisine", "sine", "burst")
STEADY = ("tone", "two tones", "tone in noise", "growing tone", "beating tones", "noise")
RECORD_COUNTS = (1, 3)


def friction() -> Cases:
    """Return the names and makers: how large the friction is in parts of the rms acceleration."""
    for size, motion in itertools.product(SIZES, MOTIONS):
        yield f"{size}/{motion}", partial(_rubbing, size, motion)


def steady() -> Cases:
    """Return the names and makers: what is declared a decay and is none."""
    for kind, count in itertools.product(STEADY, RECORD_COUNTS):
        yield f"{kind}/{count}", partial(_steady, kind, count)


def _rubbing(size: str, motion: str, rng: np.random.Generator) -> Trial:
    conditions, drawn = draw_setting(
        "accelerometer", "acceleration", rng, ("in",), ("light", "damped")
    )
    noise = draw_noise(rng, (1e-4, 3e-3))
    shape = (8, 1000) if motion == "sine" else (4, 2000)
    force_fraction = log_uniform(*SIZES[size], rng)
    moves = draw_motions(motion, conditions, rng, shape)
    answers = rubbed(moves, conditions.sensor, force_fraction, shape[1], conditions.rate)
    time_s = np.arange(shape[1]) / conditions.rate
    declared = {"burst": "random"}.get(motion, motion.partition(" ")[0])
    recordings = []
    sound = []
    for i, (move, answer) in enumerate(zip(moves, answers, strict=True)):
        for response, into in (
            (answer, recordings),
            (move.response(conditions.sensor, time_s), sound),
        ):
            channels = recorded(move.acceleration(time_s), response, conditions.rate, noise, rng)
            into.append(Raw(f"{declared}-{i}", *channels, conditions.rate, declared))
    text = f"friction {force_fraction:.2e}; {describe(conditions, recordings, noise, drawn)}"
    named = frozenset({"nonlinear"})
    return faulty_trial(recordings, sound, conditions, "dry friction", text, expected=named)


def rubbed(
    moves: list[Motion], sensor: Sensor, force_fraction: float, samples: int, rate: float
) -> Real:
    """Return responses (records, samples) of ẍ + 2δω ẋ + ω² x = a − F sgn ẋ, F in parts of a's rms.

    Each of the steps solves the linear sensor exactly for an acceleration that is straight within
    it; where the mass turns it sticks as long as the spring and the acceleration are below F.
    A quarter of the record before it begins is computed and left out.
    """
    step = 1.0 / (rate * STEPS_PER_SAMPLE)
    before = samples // 4
    t = (np.arange((samples + before) * STEPS_PER_SAMPLE + 1) - before * STEPS_PER_SAMPLE) * step
    push = np.array([_at(move, t) for move in moves])
    inner = push[:, before * STEPS_PER_SAMPLE :: STEPS_PER_SAMPLE]
    force = force_fraction * np.array([level(values) for values in inner])
    w = TAU * sensor.parameters["natural_frequency"]
    d = sensor.parameters["damping_ratio"]
    block = np.zeros((4, 4))  # state, acceleration and its slope
    block[:2, :2] = [[0.0, w], [-w, -2.0 * d * w]]  # x ω², v ω
    block[1, 2] = w
    block[2, 3] = 1.0 / step
    propagator = expm(block * step)
    move_on = propagator[:2, :2].T
    from_level = propagator[:2, 2]
    from_slope = propagator[:2, 3]
    state = np.zeros((len(moves), 2))
    out = np.zeros((len(moves), samples))
    for k in range((samples + before) * STEPS_PER_SAMPLE):
        if k % STEPS_PER_SAMPLE == 0 and k >= before * STEPS_PER_SAMPLE:
            out[:, k // STEPS_PER_SAMPLE - before] = state[:, 0]
        drive = push[:, k]
        direction = np.sign(state[:, 1])
        resting = direction == 0.0
        free = drive - state[:, 0]
        direction = np.where(
            resting, np.clip(free / np.maximum(force, 1e-300), -1.0, 1.0), direction
        )
        held = resting & (np.abs(free) <= force)
        net = drive - force * direction
        slope = push[:, k + 1] - drive
        ahead = state @ move_on + np.outer(net, from_level) + np.outer(slope, from_slope)
        turned = ahead[:, 1] * state[:, 1] < 0.0
        stuck = turned & (np.abs(push[:, k + 1] - ahead[:, 0]) <= force)
        ahead[stuck, 1] = 0.0
        ahead[held] = state[held]
        state = ahead
    return sensor.gain * out


def _at(move: Motion, time_s: Real) -> Real:
    """Return the acceleration at evenly spaced times that may begin before zero."""
    early = move.later(float(time_s[0]))
    return early.acceleration(time_s - time_s[0])


def _steady(kind: str, count: int, rng: np.random.Generator) -> Trial:
    rate = float(rng.choice(RATES))
    samples = int(log_uniform(2e3, 2e4, rng))
    noise = draw_noise(rng, (1e-3, 1e-1))
    sensor = Sensor(
        "accelerometer", {"sensitivity": 1.0, "natural_frequency": 1.0, "damping_ratio": 0.1}
    )
    frequency = rate * log_uniform(5e-3, 0.3, rng)
    recordings = []
    for i in range(count):
        values = steady_motion(kind, frequency / rate, samples, rng)
        values = recorded_channel(values, noise, rng) * 10.0 ** rng.uniform(-3.0, 3.0)
        recordings.append(Raw(f"decay-{i}", np.zeros(0), values, rate, "decay"))
    conditions = Setting(sensor, rate, "acceleration", (0.0, rate))
    nothing = {"natural_frequency": np.inf, "damping_ratio": np.inf}
    return Trial(
        calibration(recordings, "accelerometer", "acceleration"),
        "accelerometer",
        nothing,
        cause="no decay",
        strange=True,
        drawn=describe(conditions, recordings, noise, f"tone at {frequency:.4g} Hz"),
    )


def steady_motion(kind: str, turns: float, samples: int, rng: np.random.Generator) -> Real:
    """Return a motion that goes on; ``turns``: of its tone a sample."""
    k = np.arange(samples)
    tone = np.sin(TAU * (turns * k + rng.random()))
    if kind == "two tones":
        return tone + rng.uniform(0.2, 1.0) * np.sin(TAU * (rng.uniform(0.2, 1.2) * turns * k))
    if kind == "tone in noise":
        return tone + rng.uniform(0.3, 1.0) * rng.normal(size=samples)
    if kind == "growing tone":
        return tone * np.exp(rng.uniform(0.5, 3.0) * k / samples)
    if kind == "beating tones":
        return tone + np.sin(TAU * (turns + rng.uniform(1.0, 4.0) / samples) * k)
    return rng.normal(size=samples) if kind == "noise" else tone

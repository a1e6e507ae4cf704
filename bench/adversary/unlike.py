"""Models that explain little: right is anything but an adequate result without a warning."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial

import numpy as np

from bench.adversary.defects import Raw
from bench.adversary.draws import (
    describe,
    draw_motions,
    draw_noise,
    draw_setting,
    faulty_trial,
    log_uniform,
)
from bench.adversary.physics import TAU, Complex, Motion, Real
from bench.adversary.recording import DECLARED, Setting, recorded
from bench.adversary.trial import Cases, Trial

MOTIONS = ("random", "multisine", "sweep running", "shock", "burst running")
QUANTITIES = ("acceleration", "velocity", "displacement")
MODELS = ("accelerometer", "accelerometer+delay", "velocity-pickup")
Answer = Callable[[Motion, Motion, Setting, np.random.Generator], Motion]


def modes(frequency_hz: Real, conditions: Setting, rng: np.random.Generator, count: int) -> Complex:
    """Return acceleration per acceleration of a structure with light modes all over the band."""
    low, top = conditions.band_hz
    s = 1j * TAU * frequency_hz
    total = np.zeros(frequency_hz.shape, dtype=complex)
    for _ in range(count):
        w = TAU * log_uniform(low, top, rng)
        d = log_uniform(0.005, 0.05, rng)
        total += rng.normal() * w * w / (s * s + 2.0 * d * w * s + w * w)
    return total


def _filtered(motion: Motion, factor: Complex | float) -> Motion:
    return Motion(motion.frequency_hz, motion.amplitude * factor)


def _structure(
    move: Motion, second_motion: Motion, conditions: Setting, rng: np.random.Generator
) -> Motion:
    """Another point of a structure of many modes."""
    return _filtered(move, modes(move.frequency_hz, conditions, rng, 8))


def _tower(
    move: Motion, second_motion: Motion, conditions: Setting, rng: np.random.Generator
) -> Motion:
    """Return a structure far away, of which the reference drives little, much later."""
    late = 1j * TAU * move.frequency_hz * rng.uniform(20.0, 200.0) / conditions.rate
    driven = _filtered(move, modes(move.frequency_hz, conditions, rng, 4) * np.exp(-late))
    return _sum(
        driven, _filtered(second_motion, modes(second_motion.frequency_hz, conditions, rng, 4)), 0.2
    )


def _cause(
    move: Motion, second_motion: Motion, conditions: Setting, rng: np.random.Generator
) -> Motion:
    """Return the sensor's answer to what it felt, of which the reference knows little."""
    return _sum(move, second_motion, float(rng.uniform(0.05, 0.5)))


def _mode(
    move: Motion, second_motion: Motion, conditions: Setting, rng: np.random.Generator
) -> Motion:
    """Return a second mode as strong as the first."""
    fn = conditions.sensor.parameters["natural_frequency"]
    w = TAU * fn * rng.uniform(1.4, 2.5)
    s = 1j * TAU * move.frequency_hz
    share = rng.uniform(0.5, 2.0) * rng.choice([-1.0, 1.0])
    second = w * w / (s * s + 2.0 * rng.uniform(0.01, 0.05) * w * s + w * w)
    share *= conditions.sensor.parameters["sensitivity"]
    return _filtered(move, 1.0 + share * second / conditions.sensor.transfer(move.frequency_hz))


def _fixture(
    move: Motion, second_motion: Motion, conditions: Setting, rng: np.random.Generator
) -> Motion:
    """Return a fixture that resonates between the reference and the sensor."""
    w = TAU * conditions.band_hz[1] * rng.uniform(0.2, 0.8)
    s = 1j * TAU * move.frequency_hz
    return _filtered(move, w * w / (s * s + 2.0 * rng.uniform(0.005, 0.05) * w * s + w * w))


def _other_position(
    move: Motion, second_motion: Motion, conditions: Setting, rng: np.random.Generator
) -> Motion:
    """Return a reference that moves with a structure, which the sensor does not."""
    return _filtered(move, 1.0 / modes(move.frequency_hz, conditions, rng, 5))


def _late(
    move: Motion, second_motion: Motion, conditions: Setting, rng: np.random.Generator
) -> Motion:
    """Return a response that began elsewhere in the same motion."""
    return move.later(float(rng.choice([-1.0, 1.0])) * rng.uniform(50.0, 500.0) / conditions.rate)


def _sum(move: Motion, second_motion: Motion, coherence: float) -> Motion:
    """Return both motions with this share of the rms from the first."""
    first = coherence / np.linalg.norm(move.amplitude)
    second = np.sqrt(1.0 - coherence**2) / np.linalg.norm(second_motion.amplitude)
    frequency = np.concatenate([move.frequency_hz, second_motion.frequency_hz])
    amplitude = np.concatenate([first * move.amplitude, second * second_motion.amplitude])
    lines, places = np.unique(frequency, return_inverse=True)
    total = np.zeros(lines.size, dtype=complex)
    np.add.at(total, places, amplitude)
    return Motion(lines, total)


ANSWERS: dict[str, Answer] = {
    "another point of a structure": _structure,
    "a tower far away": _tower,
    "reference is not the cause": _cause,
    "second mode missing": _mode,
    "fixture resonates": _fixture,
    "reference at another place": _other_position,
    "response of another moment": _late,
}
#: A pickup of two modes is none of the simulator's, and with a delay another moment is explained.
ONE_MODEL = ("second mode missing", "response of another moment")
NOTHING_TRUE = dict.fromkeys(
    ("sensitivity", "generator_constant", "natural_frequency", "damping_ratio"), np.inf
)


def cases() -> Cases:
    """Return the names and makers."""
    for kind, motion in itertools.product(ANSWERS, MOTIONS):
        yield f"{kind}/{motion}", partial(_maker, kind, motion)


def _maker(kind: str, motion: str, rng: np.random.Generator) -> Trial:
    model = "accelerometer" if kind in ONE_MODEL else str(rng.choice(MODELS))
    quantity = str(rng.choice(QUANTITIES))
    conditions, drawn = draw_setting(model, quantity, rng, ("in", "edge"), ("light", "damped"))
    noise = draw_noise(rng, (1e-3, 1e-1))
    shape = ((1, 8000), (1, 4000), (4, 2000))[rng.integers(3)]
    declared = DECLARED.get(motion.partition(" ")[0], motion.partition(" ")[0])
    time_s = np.arange(shape[1]) / conditions.rate
    pairs = zip(
        draw_motions(motion, conditions, rng, shape),
        draw_motions(motion, conditions, rng, shape),
        strict=True,
    )
    seed = int(rng.integers(2**31))  # one structure for all records
    recordings = []
    for i, (move, second_motion) in enumerate(pairs):
        felt = ANSWERS[kind](move, second_motion, conditions, np.random.default_rng(seed))
        response = felt.response(conditions.sensor, time_s)
        channels = recorded(
            move.reference(time_s, conditions.quantity), response, conditions.rate, noise, rng
        )
        recordings.append(Raw(f"{declared}-{i}", *channels, conditions.rate, declared))
    text = describe(conditions, recordings, noise, drawn)
    return faulty_trial(
        recordings, None, conditions, f"unlike: {kind}", text, true=NOTHING_TRUE, strange=True
    )

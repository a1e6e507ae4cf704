"""Two clocks: the times of the response are (1 + ε) as far apart as those of the reference."""

from __future__ import annotations

import itertools
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
from bench.adversary.physics import TAU, Complex, Motion, Real, tones
from bench.adversary.recording import DECLARED, recorded
from bench.adversary.trial import Cases, Trial, truth

MODELS = ("accelerometer", "accelerometer+delay", "velocity-pickup")
MOTIONS = ("random", "sweep", "sweep running", "multisine", "sine", "shock", "burst")
DECADES = ((1e-6, 1e-5), (1e-5, 1e-4), (1e-4, 1e-3), (1e-3, 1e-2), (1e-2, 4e-2))
QUANTITIES = ("acceleration", "velocity", "displacement")


def cases() -> Cases:
    """Return the names and makers."""
    for (low, high), motion in itertools.product(DECADES, MOTIONS):
        yield f"{low:g} to {high:g}/{motion}", partial(_maker, low, high, motion)


def _maker(low: float, high: float, motion: str, rng: np.random.Generator) -> Trial:
    model = str(rng.choice(MODELS))
    quantity = str(rng.choice(QUANTITIES))
    conditions, drawn = draw_setting(model, quantity, rng, places=("below", "in", "edge", "above"))
    noise = draw_noise(rng, (1e-4, 1e-2))
    shape = (8, 1000) if motion == "sine" else ((1, 20_000), (1, 8000), (4, 2000))[rng.integers(3)]
    error = log_uniform(low, high, rng) * float(rng.choice([-1.0, 1.0]))
    stated = motion == "sine" and rng.random() < 0.5
    declared = DECLARED.get(motion.partition(" ")[0], motion.partition(" ")[0])
    time_s = np.arange(shape[1]) / conditions.rate
    recordings = []
    for i, move in enumerate(draw_motions(motion, conditions, rng, shape)):
        answer = Motion(
            move.frequency_hz, move.amplitude * conditions.sensor.transfer(move.frequency_hz)
        )
        response = at_steps(answer, (1.0 + error) / conditions.rate, shape[1])
        reference = move.reference(time_s, conditions.quantity)
        channels = recorded(reference, response, conditions.rate, noise, rng)
        frequency = float(move.frequency_hz[0]) if stated else None
        recordings.append(Raw(f"{declared}-{i}", *channels, conditions.rate, declared, frequency))
    text = f"ε = {error:.2e}; {describe(conditions, recordings, noise, drawn)}"
    named = frozenset({"clock_suspect"})
    true = truth(conditions.sensor)
    if motion == "shock":  # what comes at one time is as late as the clock was off by then
        true.pop("delay", None)
    return faulty_trial(recordings, None, conditions, "two clocks", text, expected=named, true=true)


def at_steps(motion: Motion, step_s: float, count: int) -> Real:
    """Return Re Σ A e^{jωt} at t = 0, step, 2 step, …, exactly.

    Where the tones lie on the lines of one period this is the chirp transform of Bluestein (1970),
    kn = (k² + n² − (k − n)²)/2, else the sum.
    """
    frequency = motion.frequency_hz
    spacing = float(np.min(np.diff(frequency))) if frequency.size > 100 else 0.0
    lines = (
        np.rint(frequency / spacing).astype(np.int64) if spacing else np.zeros(0, dtype=np.int64)
    )
    if not spacing or not np.allclose(lines * spacing, frequency, rtol=1e-9):
        return tones(frequency, motion.amplitude, np.arange(count) * step_s)
    turns = spacing * step_s
    size = int(lines.max()) + 1
    dense = np.zeros(size, dtype=complex)
    dense[lines] = motion.amplitude
    length = 1 << int(np.ceil(np.log2(size + count)))
    kernel = np.zeros(length, dtype=complex)
    kernel[:count] = np.conj(_chirp(turns, count))
    kernel[length - size + 1 :] = np.conj(_chirp(turns, size))[:0:-1]
    product = np.fft.fft(dense * _chirp(turns, size), length) * np.fft.fft(kernel)
    return np.real(np.fft.ifft(product)[:count] * _chirp(turns, count))


def _chirp(turns: float, count: int) -> Complex:
    """Return exp(jπ turns k²) for k = 0 … count − 1."""
    k = np.arange(count, dtype=float)
    return np.exp(1j * TAU * np.mod(0.5 * turns * k * k, 1.0))

"""The calibration that the benchmarks share: the sensor of Table 2 and the paper's excitation, motions known."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from vibrident.models import SensorModel, parse
from vibrident.records import STANDARD_GRAVITY, Calibration
from vibrident.simulation import SENSORS, FeltNoise, Sine, Superposition, felt_noise, one_third_octave, simulate

SENSOR = SENSORS["paper"]
#: The parameters that are identified, in the order of the table's columns.
PARAMETERS = ("sensitivity", "natural_frequency", "damping_ratio")
COLUMNS = "S0 · natural frequency · damping ratio"
RATE_HZ = 51200.0
SAMPLES = 16000
#: White noise of the response channel as a fraction of each record's rms.
RESPONSE_NOISE = 0.01
FELT_DB = 20.0
SEED = 20251113


@dataclass(frozen=True, eq=False)
class Truth:
    """A calibration without channel noise, and the motions behind its records."""

    calibration: Calibration
    motions: tuple[Superposition, ...]
    rate_hz: float
    samples: int


def model() -> SensorModel:
    """The model of the sensor."""
    return parse(SENSOR.model)


@functools.lru_cache(maxsize=2)
def paper_truth(rate_hz: float = RATE_HZ, samples: int = SAMPLES, seed: int = SEED) -> Truth:
    """21 one-third-octave sines, 10 to 1000 Hz at 1 g, each with white noise 20 dB below that the sensor feels.

    Args:
        rate_hz: samples per second; the noise reaches 0.4 of it.
        samples: of every record.
        seed: of the noise that is felt.
    """
    rms = STANDARD_GRAVITY / np.sqrt(2.0) * 10.0 ** (-FELT_DB / 20.0)
    streams = np.random.SeedSequence(seed).spawn(21)
    motions = []
    for frequency, entropy in zip(one_third_octave(10.0, 1000.0), streams, strict=True):
        rng = np.random.default_rng(entropy)
        noise = felt_noise(rms, sampling_rate_hz=rate_hz, samples=samples, rng=rng)
        motions.append(Superposition((Sine(float(frequency), STANDARD_GRAVITY, -0.5 * np.pi), noise)))
    calibration = simulate(SENSOR, motions, sampling_rate_hz=rate_hz, samples=samples, seed=seed)
    return Truth(calibration, tuple(motions), rate_hz, samples)


def relative_errors(values: dict[str, float]) -> dict[str, float]:
    """Found over true, less one, for each parameter."""
    return {name: values[name] / SENSOR.parameters[name] - 1.0 for name in PARAMETERS}


def tones_of(motion: Superposition) -> list[tuple[np.ndarray, np.ndarray, float | None]]:
    """(frequencies in Hz, phasors in m/s², fundamental in Hz or None) of each part of a motion of ``paper_truth``."""
    parts = [part.tones for part in motion.parts if isinstance(part, Sine | FeltNoise)]
    return [(tones.frequency_hz, tones.phasor, tones.fundamental_hz) for tones in parts]

"""One record of random motion of an exact sensor, for departures from it."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import Calibration, Record

SAMPLES, RATE_HZ = 8000, 20e3
TRUTH = {"sensitivity": 0.1, "natural_frequency": 1200.0, "damping_ratio": 0.2}


def motion(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    n = 4 * SAMPLES
    hz = np.fft.rfftfreq(n, 1.0 / RATE_HZ)
    lines = ((hz > 20.0) & (hz < 4000.0)) * (rng.normal(size=hz.size) + 1j * rng.normal(size=hz.size))
    s, w = 2j * np.pi * hz, 2.0 * np.pi * TRUTH["natural_frequency"]
    h = TRUTH["sensitivity"] * w**2 / (s**2 + 2.0 * TRUTH["damping_ratio"] * w * s + w**2)
    u, y = (np.fft.irfft(v, n)[SAMPLES : 2 * SAMPLES] for v in (lines, lines * h))
    return u / np.std(u), y / np.std(u) + 1e-4 * rng.normal(size=SAMPLES)


def calibration(u: np.ndarray, y: np.ndarray) -> Calibration:
    return Calibration(records=(Record("random", u, y, RATE_HZ, "random"),), model="accelerometer")

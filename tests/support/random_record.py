"""One record of random motion of an exact sensor, for departures from it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import Calibration, Record

SAMPLES, RATE_HZ, BAND_HZ = 8000, 20e3, (20.0, 4000.0)
Real = NDArray[np.float64]
TRUTH = {"sensitivity": 0.1, "natural_frequency": 1200.0, "damping_ratio": 0.2}


def answered(transfer: Callable[[Real], NDArray[np.complex128]], rng: np.random.Generator) -> tuple[Real, Real]:
    """Reference and exact response of a piece of a long random motion; ``transfer``: at frequencies above zero, Hz."""
    n = 4 * SAMPLES
    hz = np.fft.rfftfreq(n, 1.0 / RATE_HZ)
    lines = ((hz > BAND_HZ[0]) & (hz < BAND_HZ[1])) * (rng.normal(size=hz.size) + 1j * rng.normal(size=hz.size))
    hz[0] = hz[1]
    reference, response = (np.fft.irfft(v, n)[SAMPLES : 2 * SAMPLES] for v in (lines, lines * transfer(hz)))
    return reference, response


def oscillator(hz: Real) -> NDArray[np.complex128]:
    """Response of the sensor to acceleration."""
    s, w = 2j * np.pi * hz, 2.0 * np.pi * TRUTH["natural_frequency"]
    return np.asarray(TRUTH["sensitivity"] * w**2 / (s**2 + 2.0 * TRUTH["damping_ratio"] * w * s + w**2))


def motion(rng: np.random.Generator) -> tuple[Real, Real]:
    """Reference of rms one and the sensor's response with noise of 1e-4."""
    u, y = answered(oscillator, rng)
    return u / np.std(u), y / np.std(u) + 1e-4 * rng.normal(size=SAMPLES)


def calibration(u: Real, y: Real) -> Calibration:
    """One record, of an accelerometer."""
    return Calibration(records=(Record("random", u, y, RATE_HZ, "random"),), model="accelerometer")

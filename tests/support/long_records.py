"""Random motion of an exact sensor, of any length, in memory and in an HDF5 file."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

RATE_HZ = 20e3
BAND_HZ = (20.0, 4000.0)
TRUTH = {"sensitivity": 0.1, "natural_frequency": 1200.0, "damping_ratio": 0.2}
NOISE = 1e-3
CALIBRATION = """[sensor]
model = "accelerometer"
[reference]
column = "reference"
quantity = "acceleration"
[response]
column = "response"
unit = "V"
[sampling]
rate_hz = 20000.0
[[records]]
file = "records.h5"
excitation = "random"
"""


def random_motion(samples: int, seed: int, truth: dict[str, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Reference of rms one, and the response of an accelerometer with noise of 1e-3 of it; not periodic."""
    rng = np.random.default_rng(seed)
    count = samples + samples // 4
    hz = np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    lines = ((hz > BAND_HZ[0]) & (hz < BAND_HZ[1])) * (rng.normal(size=hz.size) + 1j * rng.normal(size=hz.size))
    s, w = 2j * np.pi * hz, 2.0 * np.pi * truth["natural_frequency"]
    transfer = truth["sensitivity"] * w**2 / (s**2 + 2.0 * truth["damping_ratio"] * w * s + w**2)
    reference, response = (np.fft.irfft(values, count)[:samples] for values in (lines, lines * transfer))
    response, size = response / np.std(reference), np.std(reference)
    return reference / size, response + NOISE * np.std(response) * rng.normal(size=samples)


def in_file(folder: Path, reference: NDArray[np.float64], response: NDArray[np.float64], more: str = "") -> Path:
    """Write both channels and a calibration file; return its path."""
    folder.mkdir(exist_ok=True)
    with h5py.File(folder / "records.h5", "w") as file:
        file["reference"], file["response"] = reference, response
    path = folder / "calibration.toml"
    path.write_text(CALIBRATION + more, encoding="utf-8")
    return path

"""Simulated calibrations as files: any, and the one of the demonstration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vibrident.workflow.truth import write_truth

# The demonstration: a sensor and its calibration as in the paper's section 4, at a low rate, for small files.
SENSOR = "paper"
RATE_HZ = 12800.0
#: Of each record.
SAMPLES = 4000
#: Motion over the noise that the sensor measures too.
SNR_DB = 20.0
#: Of the response, relative to its rms.
RESPONSE_NOISE = 0.01
SEED = 1


def write_demo(folder: Path) -> None:
    """Write the calibration of the demonstration and its truth."""
    write(
        folder,
        SENSOR,
        "sine",
        sampling_rate_hz=RATE_HZ,
        samples=SAMPLES,
        excitation_snr_db=SNR_DB,
        response_noise=RESPONSE_NOISE,
        seed=SEED,
    )


def write(folder: Path, sensor: str, excitation: str, *, seed: int, **settings: Any) -> None:
    """Write a simulated calibration and its truth into a folder; settings as those of ``vibrident.simulate``."""
    from vibrident.io import write_calibration
    from vibrident.simulation import sensor_named
    from vibrident.simulation import simulate as run

    chosen = sensor_named(sensor)
    calibration = run(chosen, excitation, seed=seed, **settings)
    write_calibration(folder, calibration)
    write_truth(folder / "truth.json", chosen, calibration, seed)

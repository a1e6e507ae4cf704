"""One oscillator seen in several calibrations, with noise of known size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import vibrident
from vibrident.data.records import Calibration, ResponseTable
from vibrident.physics.models import parse

MECHANICS = {"natural_frequency": 630.0, "damping_ratio": 0.2}
SENSITIVITY = {"sensitivity": 0.1}
#: Relative standard uncertainty of a table's magnitudes, and of its phases in rad.
NOISE = 0.003
POINTS_HZ = np.geomspace(50.0, 1500.0, 12)


def table(
    seed: int,
    model: str = "accelerometer",
    values: Mapping[str, float] = MECHANICS | SENSITIVITY,
    frequency_hz: np.ndarray = POINTS_HZ,
    **more: Any,
) -> Calibration:
    """A table of sine points; ``more`` goes to the calibration."""
    random = np.random.default_rng(seed)
    response = np.asarray(parse(model).frequency_response(values, frequency_hz))
    size, count = np.abs(response), len(frequency_hz)
    return Calibration(
        table=ResponseTable(
            frequency_hz,
            size * (1.0 + NOISE * random.standard_normal(count)),
            np.angle(response) + NOISE * random.standard_normal(count),
            NOISE * size,
            np.full(count, NOISE),
        ),
        model=model,
        **more,
    )


def shock(seed: int) -> Calibration:
    """A shock, recorded with a delay of its own."""
    values = MECHANICS | SENSITIVITY | {"delay": 3e-5}
    return vibrident.simulate(
        ("accelerometer+delay", values), "shock",
        sampling_rate_hz=25600.0, samples=2048, amplitude=100.0, response_noise=0.01, seed=seed,
    )  # fmt: skip


def pickups(seed: int) -> tuple[Calibration, Calibration]:
    """Displacement and velocity of one mass, by two outputs with a delay each, in sine records."""
    mechanics = {"natural_frequency": 4.5, "damping_ratio": 0.6}
    sines: dict[str, Any] = {
        "frequencies_hz": np.geomspace(1.0, 20.0, 6), "sampling_rate_hz": 500.0, "samples": 2000,
        "amplitude": 1.0, "response_noise": 0.02,
    }  # fmt: skip
    displacement = ("accelerometer+delay", mechanics | {"sensitivity": 0.1, "delay": 1e-4})
    velocity = ("velocity-pickup+delay", mechanics | {"generator_constant": 28.0, "delay": -2e-4})
    return (
        vibrident.simulate(displacement, "sine", seed=seed, **sines),
        vibrident.simulate(velocity, "sine", seed=seed + 10_000, **sines),
    )

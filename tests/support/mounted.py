"""A sensor on mountings: tables of its response with noise of known size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibrident.data.records import Calibration, ResponseTable
from vibrident.physics.models import parse

SENSOR = {"sensitivity": 1e-3, "natural_frequency": 45e3, "damping_ratio": 0.02}
COUPLING = {"mounting_frequency": 30e3, "mounting_damping": 0.03}
WIDE_HZ = np.geomspace(1e3, 60e3, 20)
LOW_HZ = np.geomspace(200.0, 15e3, 20)


def table(
    seed: int, model: str, values: Mapping[str, float], frequency_hz=WIDE_HZ, noise=1e-3, **more: Any
) -> Calibration:
    """A table of the model's response with relative noise; ``more`` goes to the calibration."""
    random = np.random.default_rng(seed)
    response = np.asarray(parse(model).frequency_response(values, frequency_hz))
    size, count = np.abs(response), len(frequency_hz)
    points = ResponseTable(
        frequency_hz,
        size * (1.0 + noise * random.standard_normal(count)),
        np.angle(response) + noise * random.standard_normal(count),
        noise * size,
        np.full(count, noise),
    )
    return Calibration(table=points, **{"model": model, **more})

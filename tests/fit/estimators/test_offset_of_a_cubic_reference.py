"""A nonlinear spring feels the offset of its reference, which the mean of a motion is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vibrident import identify
from vibrident.data.records import Calibration, Record
from vibrident.physics.simulation import sensor_named, simulate, with_noise

SENSOR = sensor_named("cubic")


def with_offset(record: Record, offset_rms: float) -> Record:
    """Return a record whose reference has an offset in addition, in its own rms."""
    assert record.reference is not None
    offset = offset_rms * float(np.std(record.reference))
    return replace(record, reference=record.reference + offset)


def calibration(motion: str, offset_rms: float, seed: int) -> Calibration:
    clean = simulate(SENSOR, motion, samples=4000, repeats=2, seed=seed)
    noisy = with_noise(clean, response_noise=1e-3, seed=seed + 50)
    return replace(noisy, records=tuple(with_offset(record, offset_rms) for record in noisy.records))


@pytest.mark.parametrize(("motion", "offset_rms", "seed"), [("random", 0.0, 3), ("random", 0.4, 5), ("sweep", 0.4, 3)])
def test_a_clean_motion_of_any_mean_and_offset_is_right(motion, offset_rms, seed):
    result = identify(calibration(motion, offset_rms, seed))
    assert not result.warnings
    for name, parameter in result.parameters.items():
        if name in SENSOR.parameters:
            deviation = parameter.value - SENSOR.parameters[name]
            assert abs(deviation) < 4.0 * parameter.standard_uncertainty, name

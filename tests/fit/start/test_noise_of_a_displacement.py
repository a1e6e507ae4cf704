"""Shocks against a displacement that goes on behind them: it leaks, and no leakage is noise.

The noise of the reference was read 50,000 times too high, clean shocks had no start value, and a
fit was surest where it was wrong.
"""

from __future__ import annotations

import numpy as np
import pytest

from vibrident import identify
from vibrident.data.records import Calibration
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.start.motion_and_noise import estimate_motion_and_noise
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import sensor_named, simulate, with_noise

SENSOR = sensor_named("paper")
NOISE = 3e-4  # of the displacement's rms


def calibration_of(samples: int, repeats: int, seed: int, motion: str = "shock") -> Calibration:
    clean = simulate(SENSOR, motion, samples=samples, repeats=repeats, seed=seed, quantity="displacement")
    return with_noise(clean, response_noise=1e-3, reference_noise=NOISE, seed=seed + 1)


@pytest.mark.parametrize("samples", [4000, 16_000, 64_000])
def test_noise_of_a_displacement_is_read_beside_its_leakage(samples):
    calibration = calibration_of(samples, 1, 1)
    [record] = calibration.records
    assert record.reference is not None
    start = dict(SENSOR.parameters)
    model = parse("accelerometer")
    problem = BinProblem.build(calibration.records, model, method("bandlimited"), "displacement", start, 0.0)
    band = Band(problem, np.inf)
    observed = estimate_motion_and_noise(band)
    [group] = band.groups
    true_power = (NOISE * np.std(record.reference)) ** 2 * group.grid.samples
    moving = observed.heard_in(group)[0]
    assert np.sum(moving) > 10
    level = observed.levels_in(group).reference[0, moving]
    assert np.all(level < 4.0 * true_power)
    assert np.all(level > 0.25 * true_power)


@pytest.mark.parametrize(("samples", "repeats"), [(4000, 1), (4000, 5), (16_000, 1), (16_000, 5)])
def test_clean_shocks_against_a_displacement_are_right(samples, repeats):
    for seed in range(3):
        result = identify(calibration_of(samples, repeats, seed))
        assert "lack_of_fit" not in result.warning_codes
        for name, parameter in result.parameters.items():
            if name in SENSOR.parameters and parameter.standard_uncertainty is not None:
                deviation = abs(parameter.value - SENSOR.parameters[name])
                assert deviation < 4.0 * parameter.standard_uncertainty, (seed, name)


@pytest.mark.parametrize("seed", [11, 12])
def test_clean_sweeps_against_a_noisy_displacement_are_right(seed):
    """Their sensitivity was 1e-8, or right and "the model explains 0 %": in the highest bins."""
    result = identify(calibration_of(10_000, 10, seed, "sweep"))
    assert not result.warnings
    sensitivity = result.parameters["sensitivity"]
    deviation = abs(sensitivity.value - SENSOR.parameters["sensitivity"])
    assert deviation < 4.0 * sensitivity.standard_uncertainty


@pytest.mark.parametrize("name", ["geophone", "seismometer"])
def test_clean_shocks_of_a_pickup_of_velocity_are_right(name):
    """Below its natural frequency the response is as steep as the cube of the frequency."""
    sensor = sensor_named(name)
    clean = simulate(sensor, "shock", samples=10_000, repeats=3, seed=1, quantity="displacement")
    result = identify(with_noise(clean, response_noise=1e-3, reference_noise=NOISE, seed=2))
    assert set(result.warning_codes) <= {"weakly_determined"}
    for parameter_name, value in sensor.parameters.items():
        parameter = result.parameters[parameter_name]
        assert abs(parameter.value - value) < 4.0 * parameter.standard_uncertainty

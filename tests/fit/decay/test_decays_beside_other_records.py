"""Free decays among sines: their misfit is part of the verdict, and what lies before their release does no harm."""

from __future__ import annotations

import numpy as np
import pytest

import vibrident
from vibrident import Record, simulate
from vibrident.physics.simulation import Decay, Sine

P = {"sensitivity": 1.0, "natural_frequency": 800.0, "damping_ratio": 0.2}
MOTION = [*(Sine(f, 1.0) for f in (100.0, 300.0, 600.0, 900.0, 1500.0)), Decay(1.0)]


def calibrated(**changes):
    made = simulate(("accelerometer", P), MOTION, sampling_rate_hz=20e3, samples=1200, response_noise=1e-3, seed=3)
    other = simulate(
        ("accelerometer", P | changes), MOTION, sampling_rate_hz=20e3, samples=1200, response_noise=1e-3, seed=4
    )
    return vibrident.Calibration(records=(*made.records[:-1], other.records[-1]))


def test_a_decay_of_the_same_sensor_is_welcome_and_counts():
    calibration = calibrated()
    with_decay = vibrident.identify(calibration)
    assert with_decay.fit.adequate, with_decay.warnings
    assert with_decay.warnings == ()
    alone = vibrident.identify(vibrident.Calibration(records=calibration.records[:-1]), estimator="ipnn")
    assert with_decay.fit.degrees_of_freedom > alone.fit.degrees_of_freedom
    for name, truth in P.items():
        p = with_decay.parameters[name]
        assert abs(p.value - truth) < 4.5 * p.standard_uncertainty


@pytest.mark.parametrize("changes", [{"damping_ratio": 0.02}, {"natural_frequency": 824.0}])
def test_a_decay_of_another_sensor_is_a_misfit(changes):
    result = vibrident.identify(calibrated(**changes))
    assert not result.fit.adequate
    text = next(w.message for w in result.warnings if w.code == "lack_of_fit")
    assert "free decay" in text


def test_rest_before_a_release_does_no_harm():
    calibration = calibrated()
    decay = calibration.records[-1]
    rng = np.random.default_rng(0)
    rest = decay.response[0] + np.std(decay.response[-200:]) * rng.normal(size=700)
    late = Record("late", None, np.concatenate([rest, decay.response]), decay.sampling_rate_hz, "decay")
    result = vibrident.identify(vibrident.Calibration(records=(*calibration.records[:-1], late)))
    assert result.fit.adequate, result.warnings
    for name, truth in P.items():
        p = result.parameters[name]
        assert abs(p.value - truth) < 4.5 * p.standard_uncertainty

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


@pytest.mark.parametrize(
    "changes", [{"damping_ratio": 0.02}, pytest.param({"natural_frequency": 824.0}, marks=pytest.mark.slow)]
)
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


def test_sines_beside_decays_take_nothing_from_what_the_decays_say(rng):
    """Decays and sines in one fit know at least what the decays know: u is a bound by theory, and
    may be larger only by the scatter of the noise that is estimated (5 % of u; 22 times before)."""
    natural_hz, damping, rate, time = 2000.0, 0.05, 10_000.0, np.arange(2000) / 10_000.0
    angular = 2 * np.pi * natural_hz
    decays = [
        np.exp(-damping * angular * time) * np.cos(angular * np.sqrt(1 - damping**2) * time + phase)
        for phase in (0.0, 1.0)
    ]
    records = [
        Record(f"decay {n}", None, free + 1e-3 * rng.normal(size=time.size), rate, "decay")
        for n, free in enumerate(decays)
    ]
    for frequency in (200.0, 400.0, 800.0):
        ratio = frequency / natural_hz
        response = 0.1 / (1 - ratio**2 + 2j * damping * ratio) * np.exp(2j * np.pi * frequency * time)
        noise = 5e-3 * rng.normal(size=time.size)
        motion = 10 * np.cos(2 * np.pi * frequency * time)
        records.append(Record(f"sine {frequency}", motion, response.real + noise, rate, "sine"))
    alone = vibrident.identify(vibrident.Calibration(tuple(records[:2]), model="accelerometer"))
    both = vibrident.identify(vibrident.Calibration(tuple(records), model="accelerometer"))
    assert both.warning_codes == ()
    for name, truth in (("natural_frequency", natural_hz), ("damping_ratio", damping)):
        stated = both.parameters[name]
        assert stated.standard_uncertainty < 1.05 * alone.parameters[name].standard_uncertainty
        assert abs(stated.value - truth) < 4 * stated.standard_uncertainty

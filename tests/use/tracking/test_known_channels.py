"""Tracking through channels of known response: as beside a laser, and the certificate in u."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.known_channels import RATE_HZ, SENSOR, Motion, accelerometer, back_to_back, known_reference

from vibrident import Calibration, KnownResponse, Result, identify, track

AMPLIFIER = KnownResponse.from_corners([0.5], [30e3], 10.0)
SAMPLES = 60_000
DRIFT = 1e-6  # a year, so that the samples alone limit what is known


@pytest.fixture(scope="module")
def result() -> Result:
    return identify(back_to_back())


def followed(*sensors: tuple[float, float, float], **stated: KnownResponse) -> Calibration:
    """A record a sensor, seen by both channels behind their known responses."""
    references, responses = [], []
    for seed, values in enumerate(sensors, start=5):
        motion = Motion("random", SAMPLES, RATE_HZ, (50.0, 12000.0), seed)
        references.append(motion.channel(known_reference().value))
        responses.append(motion.channel(accelerometer(*values), AMPLIFIER.value, noise=1e-3))
    known = {"reference_known_response": known_reference(), "response_known_response": AMPLIFIER} | stated
    return Calibration.from_arrays(references, responses, RATE_HZ, excitation="random", **known)


def test_a_sensor_that_stays_has_no_alarm_and_keeps_its_values(result):
    tracking = track(result, followed(SENSOR), drift_per_year=DRIFT)
    assert tracking.alarms == ()
    for name, truth in zip(result.parameters, SENSOR, strict=False):
        parameter = tracking.result.parameters[name]
        assert parameter.value == pytest.approx(truth, abs=4.0 * parameter.standard_uncertainty)
        assert parameter.standard_uncertainty < result.parameters[name].standard_uncertainty


def test_a_change_is_found_through_the_channels(result):
    changed = (SENSOR[0], SENSOR[1] * 0.99, SENSOR[2])
    tracking = track(result, followed(SENSOR, changed), drift_per_year=DRIFT)
    assert {alarm.parameter for alarm in tracking.alarms} == {"natural_frequency"}
    assert tracking.alarms[0].time_s == pytest.approx(0.0, abs=2.0 * SAMPLES / RATE_HZ)
    assert tracking.alarms[-1].after == pytest.approx(changed[1], rel=1e-3)


def test_the_certificate_of_the_reference_is_in_u(result):
    unsure = known_reference(standard_uncertainty=0.0025, phase_uncertainty_rad=1e-3)
    calibration = followed(SENSOR, reference_known_response=unsure)
    tracking = track(result, calibration, drift_per_year=DRIFT)
    stated = identify(calibration)
    for name in ("sensitivity", "natural_frequency"):
        u = stated.parameters[name].standard_uncertainty
        assert tracking.result.parameters[name].standard_uncertainty == pytest.approx(u, rel=0.2)
    sources = {row["source"] for row in tracking.result.settings["uncertainty_budget"]}
    assert "poles and zeros" in sources
    sensitivity = tracking.result.parameters["sensitivity"]
    assert sensitivity.standard_uncertainty == pytest.approx(0.0025 * SENSOR[0], rel=0.1)
    assert np.isfinite(tracking.result.parameters["natural_frequency"].standard_uncertainty)

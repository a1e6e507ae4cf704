"""A correction takes the known response of the recording channel out, with its uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.support.known_channels import RATE_HZ, SENSOR, Motion, accelerometer, back_to_back, known_reference

from vibrident import Calibration, InputError, KnownResponse, Result, correct, identify

AMPLIFIER = {"highpass_hz": [0.5], "lowpass_hz": [20e3], "gain": 10.0}
STATED = KnownResponse.from_corners(**AMPLIFIER, corner_uncertainty=0.05, standard_uncertainty=0.003)


@pytest.fixture(scope="module")
def result() -> Result:
    return identify(back_to_back())


def through(kind: str, seen_by: KnownResponse | None = None, **known: KnownResponse) -> tuple[Calibration, np.ndarray]:
    """Records through an amplifier and, of the reference, another channel; and the acceleration that they show."""
    motion = Motion(kind, 8192, RATE_HZ, (50.0, 4000.0), 3)
    seen = motion.channel() if seen_by is None else motion.channel(seen_by.value)
    response = motion.channel(accelerometer(*SENSOR), STATED.value, noise=1e-3)
    return Calibration.from_arrays([seen], [response], RATE_HZ, excitation=kind, **known), motion.channel()


@pytest.mark.parametrize("kind", ["random", "shock"])
def test_the_motion_is_that_of_the_sensor_without_an_amplifier(result, kind):
    calibration, motion = through(kind, response_known_response=STATED)
    (corrected,) = correct(result, calibration).corrections
    off = (corrected.acceleration - corrected.reference)[400:-400]
    assert np.mean(np.abs(off) <= 1.96 * corrected.standard_uncertainty[400:-400]) > 0.9
    assert np.std(off) < 0.01 * np.std(motion)
    assert corrected.components["model"].max() > 2e-3 * np.max(np.abs(motion))


def test_the_uncertainty_of_the_channel_is_that_of_its_draws(result):
    """Relative deviation of the record from its mean over draws of gain and corners, and u of the model."""
    rng = np.random.default_rng(5)
    calibration, _ = through("shock", response_known_response=STATED)
    restored = []
    for _ in range(25):
        errors = 1.0 + 0.05 * rng.normal(size=2)
        gain = 10.0 * (1.0 + 0.003 * rng.normal())
        drawn = KnownResponse.from_corners([0.5 * errors[0]], [20e3 * errors[1]], gain)
        other = replace(calibration, response_known_response=drawn)
        (each,) = correct(result, other, band_hz=(0.0, 4000.0)).corrections
        restored.append(each.acceleration)
    (corrected,) = correct(result, calibration, band_hz=(0.0, 4000.0)).corrections
    certain = replace(calibration, response_known_response=KnownResponse.from_corners(**AMPLIFIER))
    (bare,) = correct(result, certain, band_hz=(0.0, 4000.0)).corrections
    stated = np.sqrt(np.maximum(corrected.components["model"] ** 2 - bare.components["model"] ** 2, 0.0))
    large = np.abs(corrected.acceleration) > 0.3 * np.max(np.abs(corrected.acceleration))
    found = np.std(restored, axis=0)[large]
    assert np.median(found / stated[large]) == pytest.approx(1.0, abs=0.45)


def test_the_reference_is_compared_through_its_own_response(result):
    known = known_reference()
    calibration, motion = through("shock", known, response_known_response=STATED, reference_known_response=known)
    corrections = correct(result, calibration, band_hz=(0.0, 4000.0))
    (corrected,) = corrections.corrections
    assert corrected.agreement.nrmse < 0.01
    assert corrected.agreement.rmse_unfiltered is None
    np.testing.assert_allclose(corrected.reference[800:-800], motion[800:-800], atol=0.02 * np.max(np.abs(motion)))


@pytest.mark.parametrize(("factor", "is_said"), [(1.0, False), (10.0, True), (-1.0, True)])
def test_a_record_of_other_units_contradicts_its_reference(result, factor, is_said):
    calibration, _ = through("shock", response_known_response=STATED)
    (record,) = calibration.records
    scaled = replace(calibration, records=(replace(record, response=factor * record.response),))
    findings = correct(result, scaled, band_hz=(0.0, 4000.0)).findings
    assert is_said == any(finding.code == "units_suspect" for finding in findings)


def test_a_reference_that_is_not_known_in_the_band_is_not_compared_and_said(result):
    hz = np.geomspace(30.0, 2000.0, 60)
    known = KnownResponse.from_table(hz, np.ones(60), np.zeros(60))
    calibration, _ = through("shock", known, response_known_response=STATED, reference_known_response=known)
    corrections = correct(result, calibration)
    assert corrections.corrections[0].agreement is None
    assert any("is not compared with the reference" in finding.message for finding in corrections.findings)


def test_a_channel_known_between_frequencies_keeps_the_band_between_them(result):
    hz = np.geomspace(40.0, 6000.0, 80)
    value = STATED.value(hz)
    table = KnownResponse.from_table(hz, np.abs(value), np.angle(value))
    calibration, _ = through("random", response_known_response=table)
    (corrected,) = correct(result, calibration).corrections
    assert corrected.band.low_hz >= 80.0
    assert corrected.band.stop_hz <= 6000.0
    assert corrected.agreement.nrmse < 0.05
    with pytest.raises(InputError, match="begins where the response of the channel is not known"):
        correct(result, calibration, band_hz=(20.0, 1000.0))

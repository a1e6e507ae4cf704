"""Sines that ring up, with a noisy reference: the tone is what the sensor answers to all of the motion."""

import numpy as np
import pytest

import vibrident
from vibrident.fit.estimators.residual_tones import network_problem, roughly_cleaned
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.physics.models import parse

RATE_HZ, SAMPLES, FINE, BEFORE = 1e4, 4000, 4, 2000
TRUE = {"sensitivity": 0.01, "natural_frequency": 800.0, "damping_ratio": 0.05}


def ringing_up(frequency_hz, periods, rng):
    """Acceleration and response of a sine that begins in the record: exact for what is sampled four times as fast."""
    count = (SAMPLES + 2 * BEFORE) * FINE
    time = (np.arange(count) / FINE - BEFORE) / RATE_HZ
    rise = np.where(time < 0.0, 0.0, 1.0 - np.exp(-np.clip(time, 0.0, None) * frequency_hz / periods))
    fall = 0.5 * (1.0 - np.cos(np.pi * np.clip((time[-1] - time) * RATE_HZ / 1500.0, 0.0, 1.0)))
    lines = np.fft.rfftfreq(count, 1.0 / (RATE_HZ * FINE))
    envelope = np.fft.irfft(np.fft.rfft(rise * fall) * np.exp(-((lines / frequency_hz) ** 2)), count)
    motion = 10.0 * envelope * np.sin(2.0 * np.pi * frequency_hz * time + rng.uniform(0.0, 6.0))
    ratio = lines / TRUE["natural_frequency"]
    gain = TRUE["sensitivity"] / (1.0 - ratio**2 + 2j * TRUE["damping_ratio"] * ratio)
    answer = np.fft.irfft(np.fft.rfft(motion) * gain, count)
    kept = slice(BEFORE * FINE, (BEFORE + SAMPLES) * FINE, FINE)
    return motion[kept], answer[kept]


@pytest.mark.parametrize("periods", [0.5, 3.0, 20.0])
def test_a_noisy_reference_does_not_hide_that_the_motion_rings_up(periods):
    """Above the resonance the reference's noise is loud in the residual, and a plain sine was fitted: 15 u beside."""
    rng = np.random.default_rng(7)
    pairs = [ringing_up(f, periods, rng) for f in (61.3, 204.7, 601.9, 911.3, 1443.9, 1987.1)]
    reference = [x + 0.01 * rng.standard_normal(SAMPLES) for x, _ in pairs]
    response = [y + 1e-3 * np.std(y) * rng.standard_normal(SAMPLES) for _, y in pairs]
    result = vibrident.identify(vibrident.Calibration.from_arrays(reference, response, RATE_HZ, model="accelerometer"))
    assert result.warning_codes == ()
    for name, value in TRUE.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4.0 * found.standard_uncertainty


def test_tones_of_few_periods_are_not_cleaned_under_a_window_that_needs_more():
    """It mixes them with offset and mirror image: from such start values two of 12 calibrations were rejected."""
    time, model = np.arange(400) / RATE_HZ, parse("accelerometer")
    motions = [np.sin(2.0 * np.pi * periods / time[-1] * time + 0.3) for periods in (1.2, 1.8, 20.0)]
    made = vibrident.Calibration.from_arrays(motions, [0.01 * m for m in motions], RATE_HZ, model=model.name)
    evidence = Evidence.gather(made, model)
    coordinates = Coordinates.at(model, TRUE, evidence.band_hz)
    found = roughly_cleaned(evidence, network_problem(evidence, TRUE), coordinates, coordinates.first)
    assert found is not None
    assert evidence.first_look is not None
    kept = found.data[2] == evidence.first_look.data[2]
    assert kept.tolist() == [True, True, False]

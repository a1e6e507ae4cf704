"""What a model lacks is said once: its misfit is no harmonic, and noise of the reference no misfit."""

from __future__ import annotations

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, Record

RATE_HZ, SAMPLES = 10240.0, 10240
NOISE = 1e-4


def accelerometer(hz):
    """0.1 V/(m/s²), 900 Hz, damping 0.05."""
    return 0.1 / (1.0 - (hz / 900.0) ** 2 + 0.1j * hz / 900.0)


LACKING = {
    "a low-pass": lambda hz: 1.0 / (1.0 + 1j * hz / 8000.0),
    "ripples": lambda hz: 1.0 + 0.01 * np.sin(hz / 130.0),
}


@pytest.mark.parametrize("lacking", LACKING.values(), ids=LACKING)
def test_the_misfit_of_a_tone_is_no_harmonic_of_it(lacking):
    """Pure tones: where a tone is no whole number of periods, its misfit leaked into kω, with probability 0."""
    rng = np.random.default_rng(3)
    time = np.arange(SAMPLES) / RATE_HZ
    records = []
    for hz in (50, 100, 200, 400, 600, 800, 900, 1000, 1200, 1600):
        response = np.real(10.0 * accelerometer(hz) * lacking(hz) * np.exp(2j * np.pi * hz * time))
        response += NOISE * rng.standard_normal(SAMPLES)
        records.append(Record(f"s{hz}", 10.0 * np.cos(2.0 * np.pi * hz * time), response, RATE_HZ, "sine"))
    result = vibrident.identify(Calibration(records=tuple(records), model="accelerometer"))
    assert "lack_of_fit" in result.warning_codes
    assert "nonlinear" not in {finding.code for finding in result.findings}


@pytest.mark.parametrize("reversed_hz", [100, 600, 1600])
def test_a_sine_without_which_the_model_suffices_is_named(reversed_hz):
    """A second mode explains a reversed sine, too; the record is named all the same."""
    rng = np.random.default_rng(reversed_hz)
    time = np.arange(SAMPLES) / RATE_HZ
    records = []
    for hz in (50, 100, 200, 400, 600, 800, 900, 1000, 1200, 1600):
        response = np.real(10.0 * accelerometer(hz) * np.exp(2j * np.pi * hz * time))
        response = (-1.0 if hz == reversed_hz else 1.0) * response + NOISE * rng.standard_normal(SAMPLES)
        records.append(Record(f"s{hz}", 10.0 * np.cos(2.0 * np.pi * hz * time), response, RATE_HZ, "sine"))
    result = vibrident.identify(Calibration(records=tuple(records), model="accelerometer"))
    (message,) = [warning.message for warning in result.warnings if warning.code == "lack_of_fit"]
    assert f"Without s{reversed_hz} the model explains them" in message


@pytest.mark.parametrize("seed", [2, 5])
def test_a_right_model_behind_a_noisy_displacement_does_not_lack(seed):
    """Noise that a displacement's second derivative amplifies hid the motion, and the sensor was blamed."""
    rng = np.random.default_rng(seed)
    samples, rate_hz = 6000, 8000.0
    hz = np.fft.rfftfreq(2 * samples, 1.0 / rate_hz)
    time = (np.arange(2 * samples) - samples // 2) / rate_hz
    duration = samples / rate_hz
    inside = np.clip(time, -0.3 * duration, 1.3 * duration)
    fade = np.clip((inside / duration + 0.29) / 0.25, 0.0, 1.0) * np.clip((1.29 - inside / duration) / 0.25, 0.0, 1.0)
    turns = 1600.0 * inside - 770.0 * inside**2 / duration
    lines = np.fft.rfft((0.5 - 0.5 * np.cos(np.pi * fade)) * np.sin(2.0 * np.pi * turns)) * (hz > 0.0)
    recorded = slice(samples // 2, samples // 2 + samples)
    response = np.fft.irfft(lines * accelerometer(hz))[recorded]
    displacement = np.fft.irfft(-lines / (2.0 * np.pi * np.maximum(hz, 0.1)) ** 2)[recorded]
    displacement = displacement + 1e-4 * np.std(displacement) * rng.standard_normal(samples)
    response = response + 1e-4 * np.std(response) * rng.standard_normal(samples)
    record = Record("sweep", displacement, response, rate_hz, "sweep")
    given = Calibration(records=(record,), model="accelerometer", quantity="displacement")
    result = vibrident.identify(given)
    assert "lack_of_fit" not in result.warning_codes
    sensitivity = result.parameters["sensitivity"]
    assert abs(sensitivity.value - 0.1) < 4 * sensitivity.standard_uncertainty

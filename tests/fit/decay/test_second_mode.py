"""A decay of two linear modes is told from a spring or damping that depends on the amplitude."""

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, Record

RATE_HZ = 8000.0
TIME_S = np.arange(4000) / RATE_HZ


def decay_of(*modes):
    """Modes: natural frequency, damping ratio, amplitude."""
    total = np.zeros(TIME_S.size)
    for natural_hz, damping, amplitude in modes:
        natural = 2.0 * np.pi * natural_hz
        wave = np.sin(natural * np.sqrt(1.0 - damping**2) * TIME_S + 0.3)
        total += amplitude * np.exp(-damping * natural * TIME_S) * wave
    return total


def identified(response, seed):
    noisy = response + 1e-3 * np.random.default_rng(seed).standard_normal(response.size)
    record = Record("d", None, noisy, RATE_HZ, "decay")
    return vibrident.identify(Calibration(records=(record,), model="accelerometer", quantity="acceleration"))


@pytest.mark.parametrize("second", [(1100.0, 0.02, 0.3), (760.0, 0.02, 0.1)])
def test_two_linear_modes_are_no_bent_spring(second):
    result = identified(decay_of((700.0, 0.01, 1.0), second), 3)
    assert "nonlinear" not in result.warning_codes
    (message,) = [warning.message for warning in result.warnings if warning.code == "lack_of_fit"]
    assert "Two linear modes explain d: " in message
    stated = message.partition("Two linear modes explain d: ")[-1]
    frequencies = [float(words.split()[-1]) for words in stated.split(" Hz")[:2]]
    np.testing.assert_allclose(frequencies, (700.0, second[0]), rtol=2e-3)


def test_damping_that_depends_on_the_amplitude_is_no_second_mode():
    natural = 2.0 * np.pi * 700.0
    amplitude = np.empty(TIME_S.size)
    amplitude[0] = 1.0
    for k in range(1, TIME_S.size):
        damping = 0.01 * (1.0 + amplitude[k - 1])
        amplitude[k] = amplitude[k - 1] * np.exp(-damping * natural / RATE_HZ)
    result = identified(amplitude * np.cos(natural * TIME_S), 4)
    assert "nonlinear" in result.warning_codes

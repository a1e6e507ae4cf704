"""The delay between the channels of tones on either side of a resonance is found, and is no difference of clocks."""

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, Record
from vibrident.fit.response.clock_ratio import clock_offset
from vibrident.fit.response.phase_delay import Phases, agreed_delay

RATE_HZ = 10_000.0
SAMPLES = 1000
TRUE = {"sensitivity": -2.0, "natural_frequency": 240.0, "damping_ratio": 0.03, "delay": 0.03}


def tones(rng):
    """15 tones about evenly in their logarithm, at least three lines apart."""
    frequencies_hz = np.geomspace(50.0, 2000.0, 15) * rng.uniform(0.98, 1.0, 15)
    for i in range(1, 15):
        frequencies_hz[i] = max(frequencies_hz[i], frequencies_hz[i - 1] + 3.0 * RATE_HZ / SAMPLES)
    return frequencies_hz


def record(number, rng):
    frequencies_hz = tones(rng)
    s = 2j * np.pi * frequencies_hz
    omega = 2 * np.pi * TRUE["natural_frequency"]
    sensor = TRUE["sensitivity"] * omega**2 / (s * s + 2 * TRUE["damping_ratio"] * omega * s + omega**2)
    sensor = sensor * np.exp(-s * TRUE["delay"])
    waves = np.exp(np.outer(s, np.arange(SAMPLES) / RATE_HZ)) * np.exp(2j * np.pi * rng.random((15, 1)))
    channels = [amplitude @ waves for amplitude in (np.ones(15), sensor)]
    noisy = [c.real + 1e-5 * c.real.std() * rng.standard_normal(SAMPLES) for c in channels]
    return Record(f"multisine {number}", *noisy, RATE_HZ, "multisine")


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.quick("2")
def test_a_delay_of_a_third_of_the_record_is_found_beside_a_resonance(seed):
    rng = np.random.default_rng(seed)
    records = tuple(record(number, rng) for number in range(8))
    assert clock_offset(records) == 0.0
    calibration = Calibration(records=records, model="accelerometer+delay", quantity="acceleration")
    result = vibrident.identify(calibration)
    assert set(result.warning_codes) <= {"polarity"}
    for name, value in TRUE.items():
        parameter = result.parameters[name]
        assert abs(parameter.value - value) < 4.0 * parameter.standard_uncertainty, name


@pytest.mark.parametrize("place", [40.1, 40.3, 40.5, 40.9])
def test_the_bins_around_a_tone_have_its_frequency(place):
    samples = 1000
    time = np.arange(samples)
    turn = 2.0 * np.pi / samples
    tone = np.cos(turn * place * time + 0.7)
    hann = 0.5 - 0.5 * np.cos(turn * time)
    near = np.arange(39, 43)
    windowed, sine = (np.fft.rfft(tone * window)[near] for window in (hann, np.sin(turn * time)))
    phases = Phases.between((windowed, 1j * sine), windowed * np.exp(-0.4j), near * 1.0, 1.0)
    np.testing.assert_allclose(phases.frequency_hz, place, atol=2e-3)
    np.testing.assert_allclose(phases.phase, np.exp(-0.4j), rtol=1e-9)


@pytest.mark.parametrize("delay_s", [-0.31, -0.004, 0.0, 0.02, 0.44])
def test_a_step_of_the_phase_between_octaves_does_not_move_the_delay(delay_s):
    frequency_hz = np.random.default_rng(3).uniform(1.0, 64.0, 200)
    phase = np.exp(-2j * np.pi * delay_s * frequency_hz) * np.where(frequency_hz > 16.0, -1.0, 1.0)
    found_s = agreed_delay(Phases(frequency_hz, phase, np.ones(200)), 1.0, 64.0)
    assert abs(found_s - delay_s) < 0.1 / 64.0

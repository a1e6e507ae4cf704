"""One sine tells the sensitivity at its frequency, and the model of a gain states it with its U."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtri
from tests.support.sample_results import accelerometer

from vibrident import Calibration, identify, simulate
from vibrident.data.records import ResponseTable
from vibrident.show import certificate_tables as parts
from vibrident.show import terminal
from vibrident.show.points import reference_point

HZ, RATE, NOISE, GAIN = 159.155, 10240.0, 2e-4, 0.005
TRUE = accelerometer(HZ)


def handheld(seed=1, records=1):
    """A handheld calibrator: 10 m/s² of one sine, two seconds a record."""
    rng, t = np.random.default_rng(seed), np.arange(int(2 * RATE)) / RATE
    motions, responses = [], []
    for number in range(records):
        wave = 10.0 * np.exp(1j * (2 * np.pi * HZ * t + number))
        motions.append(np.real(wave) + 0.0 * t)
        responses.append(np.real(TRUE * wave) + NOISE * rng.normal(size=t.size))
    made = Calibration.from_arrays(motions, responses, RATE, quantity="acceleration", excitation="sine")
    return replace(made, reference_standard_uncertainty=GAIN)


def test_one_sine_gives_the_sensitivity_at_its_frequency_with_its_u():
    result = identify(handheld(), "gain+delay")
    sensitivity = result.parameters["sensitivity"]
    noise = NOISE / 10.0 / abs(TRUE) * np.sqrt(2 / (2 * RATE))  # relative, of the amplitude of a sine
    assert result.warnings == ()
    assert result.fit.adequate
    assert sensitivity.value == pytest.approx(abs(TRUE), abs=5 * noise * abs(TRUE))
    assert sensitivity.standard_uncertainty / abs(TRUE) == pytest.approx(np.hypot(GAIN, noise), rel=0.02)
    assert result.response.magnitude == pytest.approx([sensitivity.value])
    assert result.response.phase_deg[0] == pytest.approx(np.rad2deg(np.angle(TRUE)), abs=5 * np.rad2deg(noise))
    point, why = reference_point(result)
    assert (point.frequency_hz, why) == (pytest.approx(HZ, rel=1e-6), "the only frequency that was measured")
    (_, frequency), (_, magnitude), *_ = parts.reference(result).rows
    assert frequency.startswith("159.155 Hz;")
    assert magnitude == "110.1 mV/(m/s²), U = 1.1 mV/(m/s²) (k = 2)"  # 2 · 0.5 %
    assert "The sensitivity is that at 159.155 Hz" in " ".join(terminal.text(result).split())


@pytest.mark.draws(12, 40)
def test_its_uncertainty_is_that_of_drawn_records(draws):
    found = [identify(handheld(seed), "gain+delay").parameters["sensitivity"].value for seed in range(draws)]
    noise = NOISE / 10.0 * np.sqrt(2 / (2 * RATE))
    squares = (draws - 1) * np.var(found, ddof=1) / noise**2
    assert chdtri(draws - 1, 1 - 1e-3) < squares < chdtri(draws - 1, 1e-3)


@pytest.mark.parametrize("records", [1, 3])
def test_another_model_of_one_frequency_proposes_the_gain(records):
    result = identify(handheld(records=records), "accelerometer")
    said = [warning.message for warning in result.warnings if warning.code == "weakly_determined"]
    assert any("159.155 Hz" in text and "gain+delay" in text for text in said)
    again = identify(handheld(records=records), "gain+delay")
    assert not [w for w in again.warnings if "gain+delay" in w.message]
    assert again.parameters["sensitivity"].value == pytest.approx(abs(TRUE), rel=1e-4)


def test_a_magnitude_alone_is_a_gain():
    table = ResponseTable(np.array([HZ]), np.array([0.0102]), magnitude_uncertainty=np.array([5e-5]))
    result = identify(Calibration(table=table, response_unit="V"), "gain")
    sensitivity = result.parameters["sensitivity"]
    assert (sensitivity.value, sensitivity.standard_uncertainty) == pytest.approx((0.0102, 5e-5))
    assert result.fit.adequate
    assert result.warnings == ()


def test_a_gain_of_several_frequencies_is_tested():
    f = np.geomspace(20, 2000, 12)
    response = accelerometer(f)
    u = 1e-3 * np.abs(response)
    table = ResponseTable(f, np.abs(response), magnitude_uncertainty=u)
    result = identify(Calibration(table=table, response_unit="V"), "gain")
    assert not result.fit.adequate
    assert "lack_of_fit" in result.warning_codes


@pytest.mark.parametrize("highest_hz", [2000.0, 24000.0])
@pytest.mark.quick("2000.0")
def test_a_gain_that_explains_nothing_is_a_lack_of_fit(highest_hz):
    """Where the reference is half noise, no band of a gain's residual is left to judge by."""
    calibration = simulate(
        "paper", "random", frequencies_hz=(20.0, highest_hz), reference_noise=0.5, response_noise=1e-3
    )
    assert "lack_of_fit" in identify(calibration, "gain").warning_codes

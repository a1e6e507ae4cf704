"""A heterodyne signal: mixed down from a carrier that is known only nearly, and drifts."""

from __future__ import annotations

import numpy as np
import pytest

import vibrident
from vibrident.data.interferometer.setting import Interferometer
from vibrident.data.interferometer.sine import fit_sine
from vibrident.physics.simulation import sensor_named
from vibrident.physics.simulation.optics import Optics, write_optical_calibration

SETTING = Interferometer("heterodyne", 632.991e-9, carrier_hz=2.0e5, direction=-1)


def test_noise_of_a_small_motion_is_not_taken_for_too_little(tmp_path):
    """The displacement of 10 kHz needs fewer samples than the response has: interpolated, its noise had no high
    frequencies, and was taken for a nonlinearity of the sensor."""
    settings = {"start": "steady", "sampling_rate_hz": 1e6, "samples": 60_000, "response_noise": 1e-3}
    settings |= {"frequencies_hz": [2000.0, 6000.0, 10_000.0], "amplitude": 100.0}
    write_optical_calibration(tmp_path, "paper", "sine", Optics(SETTING, noise=0.05), seed=5, **settings)
    calibration = vibrident.read(tmp_path / "calibration.toml")
    assert all(record.sampling_rate_hz <= record.optical.rate_hz * 1.000001 for record in calibration.records)
    assert vibrident.identify(calibration).warning_codes == ()


def test_a_wide_band_beside_the_carrier_and_an_offset_of_the_detector(tmp_path):
    """A band that fills the spectrum hid the floor, and the offset passed in part through the filter: noise that made u
    ten times as large, and alarms."""
    setting = Interferometer("heterodyne", 632.991e-9, carrier_hz=51_200.0, direction=1)
    settings = {"sampling_rate_hz": 51_200.0, "samples": 10_240, "amplitude": 3.0, "response_noise": 1e-3}
    for seed in (0, 1):
        optics = Optics(setting, rate_hz=204_800.0, noise=0.02, offsets=(0.2, 0.0))
        write_optical_calibration(tmp_path, "paper", "random", optics, seed=seed, **settings)
        result = vibrident.identify(vibrident.read(tmp_path / "calibration.toml"))
        assert result.warning_codes == ()
        for name, true in sensor_named("paper").parameters.items():
            parameter = result.parameters[name]
            assert abs(parameter.value - true) < 3.5 * parameter.standard_uncertainty < 5e-4 * true


def test_the_cyclic_error_of_mixed_frequencies_is_taken_out_of_each_record(tmp_path):
    """The carrier's phase begins anew in every record, and so does the error's: it passed for a nonlinear sensor."""
    settings = {"start": "steady", "sampling_rate_hz": 51_200.0, "samples": 5120, "response_noise": 1e-3}
    settings |= {"frequencies_hz": [200.0, 400.0, 1000.0], "amplitude": 10.0}
    optics = Optics(SETTING, rate_hz=1e6, noise=0.02, cyclic_rad=(0.01, 0.01, 0.0), carrier_drift_hz=50.0)
    write_optical_calibration(tmp_path, "paper", "sine", optics, seed=5, **settings)
    calibration = vibrident.read(tmp_path / "calibration.toml")
    assert any(effect.kind == "cyclic" for effect in calibration.effects)
    result = vibrident.identify(calibration)
    assert result.warning_codes == ()
    for name, true in sensor_named("paper").parameters.items():
        parameter = result.parameters[name]
        assert abs(parameter.value - true) < 3.0 * parameter.standard_uncertainty < 5e-4 * true


@pytest.mark.xfail(reason="noise of a filtered displacement is not seen: its harmonics pass for motion", strict=False)
def test_the_cyclic_error_of_a_motion_below_a_fringe_is_not_the_sensor_s(tmp_path):
    """Its harmonics are in the displacement and not in the response. They passed for a nonlinear sensor and an
    unsuitable model, with u a hundred times as large."""
    settings = {"start": "steady", "sampling_rate_hz": 51_200.0, "samples": 5120, "response_noise": 1e-3}
    settings |= {"frequencies_hz": [200.0, 500.0, 1000.0, 2000.0, 4000.0], "amplitude": 10.0}
    optics = Optics(SETTING, rate_hz=1e6, noise=0.02, cyclic_rad=(0.01, 0.01, 0.01))
    write_optical_calibration(tmp_path, "paper", "sine", optics, seed=3, **settings)
    calibration = vibrident.read(tmp_path / "calibration.toml")
    # Of 200 Hz, the filter beside the carrier cut the sidebands of order 4, and 0.0043 ± 0.0002 rad were taken out.
    for record in calibration.records[:3]:
        assert all(abs(size - 0.01) < 4.0 * u for _, size, u in record.optical.cyclic)
    result = vibrident.identify(calibration)
    assert result.warning_codes == ("few_fringes",)
    for name, true in sensor_named("paper").parameters.items():
        parameter = result.parameters[name]
        assert abs(parameter.value - true) < 3.0 * parameter.standard_uncertainty < 1e-3 * true


@pytest.mark.parametrize(
    ("optics", "together"),
    [
        (Optics(SETTING, noise=0.05), True),
        (Optics(SETTING, rate_hz=1e6, carrier_drift_hz=300.0, dropouts=2), False),
    ],
)
def test_displacement_of_a_heterodyne_signal(tmp_path, optics, together):
    rate, samples = (1e6, 60_000) if together else (5e4, 4000)
    settings = {"start": "steady", "sampling_rate_hz": rate, "samples": samples, "response_noise": 1e-3}
    settings |= {"frequencies_hz": [200.0, 600.0], "amplitude": 10.0}
    truth = write_optical_calibration(tmp_path, "paper", "sine", optics, seed=5, **settings)
    calibration = vibrident.read(tmp_path / "calibration.toml")
    for record, exact in zip(calibration.records, truth.records, strict=True):
        sine = fit_sine(record.reference, record.mask, record.sampling_rate_hz, record.frequency_hz)
        true = fit_sine(exact.reference, exact.mask, exact.sampling_rate_hz, exact.frequency_hz)
        turns = 2.0 * np.pi * record.start_time_s * sine.frequency_hz
        phase = np.angle(np.exp(1j * (sine.angle - turns - true.angle)))
        metres = abs(SETTING.metres_per_radian)
        noise = np.sqrt(2.0) * optics.noise * metres / true.amplitude * np.sqrt(2.0 / record.optical.samples)
        # The band that is kept is a part of all, so this noise is an upper bound.
        assert abs(sine.amplitude / true.amplitude - 1.0) < 4.0 * noise + 2e-6
        assert abs(phase) < 4.0 * noise + 2e-5
        assert abs(record.optical.carrier_hz - 2.0e5) < 250.0
    said = {finding.code for record in calibration.records for finding in record.optical.findings}
    assert said == ({"fringe_slip"} if optics.dropouts else set())

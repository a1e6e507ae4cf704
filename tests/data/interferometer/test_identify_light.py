"""From raw photodetector signals to the sensor's parameters, by the calibration file."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.interferometer.sine import fit_sine
from vibrident.physics.simulation import sensor_named
from vibrident.physics.simulation.optics import Optics, write_optical_calibration

COMMON = {"start": "steady", "sampling_rate_hz": 2e5, "samples": 24_000, "response_noise": 1e-3, "amplitude": 10.0}


def written(folder, optics, frequencies=(100.0, 300.0, 600.0, 1000.0), **more):
    settings = {**COMMON, "frequencies_hz": list(frequencies), **more}
    return write_optical_calibration(folder, "paper", "sine", optics, seed=2, **settings)


def off(result):
    truth = sensor_named("paper").parameters
    return {name: (result.parameters[name].value - value) / result.parameters[name].standard_uncertainty
            for name, value in truth.items()}  # fmt: skip


def test_sines_within_three_u_and_without_warnings(tmp_path):
    written(tmp_path, Optics(noise=0.05))
    result = vibrident.identify(vibrident.read(tmp_path / "calibration.toml"))
    assert max(abs(size) for size in off(result).values()) < 3.0
    assert [warning.code for warning in result.warnings] == []
    found = result.settings["interferometer"]["1000 Hz"]
    assert found["ellipse"]["origin"] == "common to 4 records"
    assert found["half_fringes_counted"] == found["half_fringes_by_phase"] > 0
    assert result.reference["quantity"] == "displacement"
    assert any(row["kind"] == "ellipse" for row in result.settings["uncertainty_budget"])


def test_displacement_is_as_good_as_the_noise_of_the_phase_allows(tmp_path):
    """Amplitude by the sine-approximation: within 4 standard deviations of the Cramér–Rao bound, at every amplitude."""
    truth = written(tmp_path, Optics(noise=0.05))
    for record, exact in zip(vibrident.read(tmp_path / "calibration.toml").records, truth.records, strict=True):
        sine = fit_sine(record.reference, record.mask, record.sampling_rate_hz)
        amplitude = float(np.sqrt(2.0) * np.std(exact.reference))
        scale = record.optical.setting.metres_per_radian
        bound = 0.05 * 1.005 * scale * np.sqrt(2.0 / record.optical.samples)
        assert abs(sine.amplitude - amplitude) < 4.0 * np.hypot(bound, 2e-8 * amplitude)


def test_a_delay_that_is_stated_is_taken_out(tmp_path):
    written(tmp_path, Optics(delay_s=3.3e-5))
    result = vibrident.identify(vibrident.read(tmp_path / "calibration.toml"), model="accelerometer+delay")
    delay = result.parameters["delay"]
    assert abs(delay.value) < 3.0 * delay.standard_uncertainty < 1e-7


def test_optical_signals_may_be_faster_than_the_response(tmp_path):
    written(tmp_path, Optics(rate_hz=1e6), sampling_rate_hz=2e4, samples=6000)
    result = vibrident.identify(vibrident.read(tmp_path / "calibration.toml"))
    assert max(abs(size) for size in off(result).values()) < 3.5
    assert [warning.code for warning in result.warnings] == []


def test_single_precision_of_integers_costs_less_than_their_rounding(tmp_path):
    """The phase of 16 bits at full scale is rounded by 9e-6 rad, that of float32 by 1e-7 rad."""
    written(tmp_path, Optics(bits=16), [100.0, 1000.0])
    found = vibrident.read(tmp_path / "calibration.toml")
    for path in tmp_path.glob("*.h5"):
        with h5py.File(path, "r+") as file:
            for name in {"u1", "u2"} & set(file):
                values = file[name][:]
                del file[name]
                file[name] = values.astype(float)
    exact = vibrident.read(tmp_path / "calibration.toml")
    for one, other in zip(found.records, exact.records, strict=True):
        off = (one.reference - other.reference) / one.optical.setting.metres_per_radian
        assert 0.0 < np.max(np.abs(off - np.mean(off))) < 3e-7


BASE = """
[interferometer]
kind = "quadrature"
columns = ["u1", "u2"]
wavelength_m = 632.991e-9
[response]
column = "response"
[sampling]
rate_hz = 1000.0
[[records]]
file = "a.h5"
excitation = "sine"
"""


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('columns = ["u1", "u2"]', 'columns = ["u1"]', "columns"),
        ("wavelength_m", "wavelenght_m", "wavelength_m"),
        ('kind = "quadrature"', 'kind = "heterodyne"', "one signal"),
        ("[response]", '[reference]\ncolumn = "x"\n[response]', "[reference] column"),
        ("wavelength_m = 632.991e-9", "wavelength_m = 0.0", "wavelength_m"),
        ("wavelength_m = 632.991e-9", "wavelength_m = 632.991", "write wavelength_m = 6.32991e-07"),
        ("wavelength_m = 632.991e-9", "wavelength_m = 0.632991", "write wavelength_m = 6.32991e-07"),
        ("wavelength_m = 632.991e-9", "wavelength_m = 1e-6\ncarrier_hz = 1e3", "carrier_hz"),
        ("wavelength_m = 632.991e-9", "wavelength_m = 1e-6\ndirection = 2", "direction"),
    ],
)
def test_what_contradicts_itself_is_refused(tmp_path, old, new, word):
    (tmp_path / "calibration.toml").write_text(BASE.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        vibrident.read(tmp_path / "calibration.toml")
    assert word in str(caught.value)

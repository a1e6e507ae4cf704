"""Motion that is no sine: its acceleration, within the band where it stands above the noise of the phase."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.interferometer.alignment import LOST_SAMPLES, differentiated
from vibrident.data.interferometer.setting import Interferometer
from vibrident.data.screening import screen
from vibrident.physics.simulation import sensor_named, simulate
from vibrident.physics.simulation.optics import Optics, write_optical_calibration


@pytest.mark.parametrize(("cycles", "off"), [(0.001, 1e-6), (0.2, 1e-6), (0.35, 5e-6), (0.4, 1e-3)])
def test_acceleration_is_exact_in_its_band_and_a_ramp_has_none(cycles, off):
    rate, index = 1000.0, np.arange(3000)
    omega = 2.0 * np.pi * cycles
    wave = np.cos(omega * index + 0.2)
    found, valid = differentiated(wave / (omega * rate) ** 2 + 1e-3 * index, np.ones(index.size, bool), rate)
    assert np.max(np.abs(found + wave[LOST_SAMPLES:-LOST_SAMPLES])) < off
    assert valid.all()


@pytest.mark.parametrize(
    ("kind", "rate", "optical", "amplitude"), [("shock", 51_200.0, 5.12e6, 80.0), ("sweep", 1.024e6, None, 3.0)]
)
def test_a_shock_and_a_sweep_that_end_elsewhere(tmp_path, kind, rate, optical, amplitude):
    samples = int(0.15 * rate)
    settings = {"sampling_rate_hz": rate, "samples": samples, "amplitude": amplitude, "response_noise": 1e-3}
    write_optical_calibration(tmp_path, "paper", kind, Optics(noise=0.02, rate_hz=optical), seed=3, **settings)
    result = vibrident.identify(vibrident.read(tmp_path / "calibration.toml"))
    for name, true in sensor_named("paper").parameters.items():
        parameter = result.parameters[name]
        assert abs(parameter.value - true) < 3.5 * parameter.standard_uncertainty
        assert parameter.standard_uncertainty < 1e-3 * true
    assert [warning.code for warning in result.warnings] == []


@pytest.mark.parametrize(
    ("kind", "amplitude", "optics", "said"),
    [
        # Before a shock there are no fringes: these pieces of time determine no ellipse, and the rest was ignored.
        ("shock", 80.0, Optics(noise=0.02, drift=0.1), ("ellipse_unstable",)),
        # The turns over these gaps are not determined; the acceleration does not need them. It was refused.
        ("random", 3.0, Optics(noise=0.02, dropouts=2, dropout_s=2e-3), ("fringe_slip",)),
    ],
)
def test_what_happens_to_the_light_of_other_motion_is_said_and_does_no_harm(tmp_path, kind, amplitude, optics, said):
    settings = {"sampling_rate_hz": 51_200.0, "samples": 10_240, "amplitude": amplitude, "response_noise": 1e-3}
    write_optical_calibration(tmp_path, "paper", kind, optics, seed=0, **settings)
    calibration = vibrident.read(tmp_path / "calibration.toml")
    assert calibration.records[0].optical.left_out < 0.06
    record = calibration.records[0]
    noise = np.random.default_rng(1).standard_normal(record.samples)
    named = [finding.code for finding in screen([replace(record, reference=noise)])[1]]
    assert "aliasing" not in named  # noise of light at high frequencies: its decimation lets nothing fold
    result = vibrident.identify(calibration)
    assert result.warning_codes == said
    for name, true in sensor_named("paper").parameters.items():
        assert abs(result.parameters[name].value - true) < 3.0 * result.parameters[name].standard_uncertainty


def test_noise_of_a_phase_grows_with_frequency_in_an_acceleration_and_biases_nothing():
    """Taken for white noise, it gave a false lack_of_fit each time, and u a hundred times as large."""
    truth, scaled = sensor_named("paper").parameters, []
    for seed in range(4):
        clean = simulate("paper", "shock", sampling_rate_hz=17_000.0, samples=3200, amplitude=80.0, seed=seed,
                         response_noise=1e-3)  # fmt: skip
        record, random = clean.records[0], np.random.default_rng(seed)
        noise = np.diff(random.standard_normal(record.samples + 2), 2) * 1.5
        noisy = replace(record, reference=record.reference + noise, reference_noise_order=4)
        result = vibrident.identify(replace(clean, records=(noisy,)))
        assert "lack_of_fit" not in result.warning_codes
        found = [(result.parameters[name], true) for name, true in truth.items()]
        scaled.append([(p.value - true) / p.standard_uncertainty for p, true in found])
        assert result.parameters["sensitivity"].standard_uncertainty < 1e-4 * truth["sensitivity"]
    assert np.max(np.abs(np.mean(scaled, axis=0))) < 3.0 / np.sqrt(4.0)
    assert np.sqrt(np.mean(np.square(scaled))) < 1.4


@pytest.mark.parametrize(("before_s", "refused"), [(0.008, False), (-0.001, True)])
def test_a_loss_of_light_costs_a_shock_only_if_it_falls_on_its_pulse(tmp_path, before_s, refused):
    """It cost 17 ms on either side; and with the pulse lost, the rest gave parameters 300 u off."""
    settings = {"sampling_rate_hz": 51_200.0, "samples": 10_240, "amplitude": 80.0, "response_noise": 1e-3}
    truth = write_optical_calibration(tmp_path, "paper", "shock", Optics(noise=0.02), seed=0, **settings)
    record = truth.records[0]
    start = np.argmax(np.abs(record.response) > 0.2 * np.max(np.abs(record.response))) / record.sampling_rate_hz
    for path in tmp_path.glob("*optical.h5"):
        with h5py.File(path, "r+") as file:
            rate = len(file["u1"]) / record.duration_s
            lost = slice(int((start - before_s) * rate), int((start - before_s + 2e-5) * rate))
            for name in ("u1", "u2"):
                file[name][lost] = np.mean(file[name][:])
    if refused:
        with pytest.raises(InputError, match="while the sensor moves"):
            vibrident.read(tmp_path / "calibration.toml")
        return
    result = vibrident.identify(tmp_path / "calibration.toml")
    assert result.warning_codes == ("fringe_slip",)
    for name, true in sensor_named("paper").parameters.items():
        assert abs(result.parameters[name].value - true) < 3.0 * result.parameters[name].standard_uncertainty


def shock(folder, amplitude, samples=10_240, setting=None, noise=0.02):
    """A calibration by a weak shock, as written to a folder."""
    optics = Optics(noise=noise) if setting is None else Optics(setting, noise=noise)
    settings = {"sampling_rate_hz": 51_200.0, "samples": samples, "amplitude": amplitude, "response_noise": 1e-3}
    write_optical_calibration(folder, "paper", "shock", optics, seed=1, **settings)
    return folder / "calibration.toml"


HETERODYNE = Interferometer("heterodyne", 632.991e-9, carrier_hz=12_800.0, direction=1)


@pytest.mark.parametrize(("amplitude", "setting"), [(0.3, None), (1.5, None), (0.5, HETERODYNE)])
def test_a_weak_shock_is_kept_apart_from_the_ends_of_its_record(tmp_path, amplitude, setting):
    """At the low rate that its band allows, the filters' reach swallowed the pulse: what was left was free ringing,
    with u thousands of times as large, or a sensitivity of zero that was 1200 u off."""
    result = vibrident.identify(shock(tmp_path, amplitude, setting=setting))
    assert result.warning_codes == ()
    for name, true in sensor_named("paper").parameters.items():
        assert abs(result.parameters[name].value - true) < 3.0 * result.parameters[name].standard_uncertainty
    assert (
        result.parameters["sensitivity"].standard_uncertainty < 1e-3 * sensor_named("paper").parameters["sensitivity"]
    )


@pytest.mark.parametrize(
    ("amplitude", "samples", "setting", "said"),
    [(2e-3, 10_240, None, "hidden by the noise"), (2e-3, 2048, HETERODYNE, "too near to an end")],
)
def test_a_shock_that_cannot_be_seen_is_refused(tmp_path, amplitude, samples, setting, said):
    """Less than a fringe: parameters were up to 50 000 u off."""
    with pytest.raises(InputError, match=said):
        vibrident.read(shock(tmp_path, amplitude, samples, setting))

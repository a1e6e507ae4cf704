"""Shocks of known peak: the corrected peak lies in its interval as often as stated, and the raw output is far off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import resample
from tests.support.corrections import DECENT, known_result

import vibrident
from vibrident.physics.simulation import SENSORS, ChannelNoise, HalfSineShock, simulate, with_noise

#: Sensor, pulse in s, sampling rate in Hz, noise over the response's rms.
SHOCKS = [
    ("paper", 1.5e-3, 51200.0, 1e-3),
    ("paper", 0.7e-3, 51200.0, 1e-2),
    ("paper", 4e-3, 51200.0, 1e-3),
    ("inverted", 1.5e-3, 51200.0, 1e-2),
    ("piezo", 6e-5, 1e6, 1e-3),
    ("geophone", 0.1, 2000.0, 1e-3),
    ("seismometer", 0.5, 200.0, 1e-3),
]


def shock(sensor: str, pulse: float, rate: float, samples: int = 4000) -> tuple[vibrident.Calibration, float]:
    """A shock without noise and the peak of its reference between the samples."""
    motion = HalfSineShock(SENSORS[sensor].amplitude, pulse, 0.15 * samples / rate)
    calibration = simulate(sensor, motion, sampling_rate_hz=rate, samples=samples)
    return calibration, float(np.max(np.abs(resample(calibration.records[0].reference, 8 * samples))))


def peaks(sensor: str, clean: vibrident.Calibration, noise: float | ChannelNoise, runs: int) -> np.ndarray:
    """Peak, its u, and the ends of its interval, of so many draws of noise and parameters; shape (runs, 4)."""
    truth, rng = SENSORS[sensor], np.random.default_rng(11)
    rows = []
    for seed in range(runs):
        result = known_result(truth.model, truth.parameters, DECENT, rng=rng)
        peak = vibrident.correct(result, with_noise(clean, response_noise=noise, seed=seed)).corrections[0].peak
        rows.append((peak.value, peak.standard_uncertainty, *peak.interval_95))
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "pulse", "rate", "noise"), SHOCKS)
def test_coverage_of_each_kind_of_shock(sensor: str, pulse: float, rate: float, noise: float) -> None:
    clean, truth = shock(sensor, pulse, rate, 8000)
    drawn = peaks(sensor, clean, noise, 500)
    inside = np.mean((drawn[:, 2] <= truth) & (truth <= drawn[:, 3]))
    assert inside > 0.95 - 0.03  # three standard errors of 500 draws
    assert np.sqrt(np.mean(((drawn[:, 0] - truth) / drawn[:, 1]) ** 2)) < 1.1


def test_a_zero_of_a_pulses_spectrum_is_not_its_end() -> None:
    """Half-sines whose band ends beside a zero of their spectrum: the lobe beyond was left out of u."""
    sensor = ("accelerometer", {"sensitivity": 0.25, "natural_frequency": 300.0, "damping_ratio": 1.8})
    result, noise, off = known_result(*sensor, DECENT), ChannelNoise(white=0.02), []
    for seed, pulse in enumerate(np.geomspace(1.35e-3, 1.75e-3, 12)):
        motion = HalfSineShock(50.0, float(pulse), 0.5)
        made = simulate(sensor, motion, sampling_rate_hz=4000.0, samples=8192, response_noise=noise, seed=seed)
        (done,) = vibrident.correct(result, made).corrections
        acceleration = made.records[0].reference
        assert acceleration is not None
        top = int(np.argmax(np.abs(acceleration)))
        off.append((done.acceleration[top] - acceleration[top]) / done.standard_uncertainty[top])
    assert np.sqrt(np.mean(np.square(off))) < 1.0


@pytest.mark.parametrize(
    ("sensor", "pulse", "rate"),
    [
        ("paper", 1.5e-3, 51200.0),
        ("inverted", 0.7e-3, 102400.0),
        ("piezo", 6e-5, 1e6),
        ("geophone", 0.1, 2000.0),
        ("seismometer", 0.5, 200.0),
    ],
)
@pytest.mark.quick("paper-0.0015-51200.0", "piezo-6e-05-1000000.0", "seismometer-0.5-200.0")
def test_within_half_a_percent_where_the_raw_output_is_off(sensor: str, pulse: float, rate: float) -> None:
    """The peak of the output over the gain is 15 % to 98 % off; noise of 1e-4, parameters known to 1e-4."""
    truth = SENSORS[sensor]
    clean, peak = shock(sensor, pulse, rate)
    gain = truth.parameters.get("sensitivity") or truth.parameters["generator_constant"]
    assert abs(np.max(np.abs(clean.records[0].response)) / abs(gain) / peak - 1.0) > 0.05
    rng = np.random.default_rng(3)
    for seed in range(6):
        small = {name: 0.1 * u for name, u in DECENT.items()}
        result = known_result(truth.model, truth.parameters, small, rng=rng)
        found = vibrident.correct(result, with_noise(clean, response_noise=1e-4, seed=seed)).corrections[0].peak
        assert found.value == pytest.approx(peak, rel=5e-3)


def test_the_misfit_of_a_rejected_model_is_in_the_interval() -> None:
    """A second mode of 2 % within the calibrated band, left out: the peaks are off, and the intervals know by how much.

    Without the misfit (``adequate`` set by hand) the same calibrations state a u that is many times too small.
    """
    values = {**SENSORS["paper"].parameters, "mode2_frequency": 300.0, "mode2_damping": 0.05, "mode2_gain": 0.02}
    tones = np.geomspace(20.0, 1500.0, 10).tolist()
    sensor = ("accelerometer+mode2", values)
    shape = {"sampling_rate_hz": 51200.0, "samples": 4000}
    sines = simulate(sensor, "sine", frequencies_hz=tones, start="steady", amplitude=9.8, response_noise=1e-3, **shape)
    result = vibrident.identify(sines, model="accelerometer")
    assert not result.fit.adequate
    trusted = replace(result, fit=replace(result.fit, adequate=True))
    with_misfit, without = [], []
    for pulse in np.geomspace(0.7e-3, 8e-3, 6):
        noisy = simulate(sensor, HalfSineShock(9.8, pulse, 0.012), response_noise=1e-3, **shape)
        peak = float(np.max(np.abs(resample(noisy.records[0].reference, 8 * 4000))))
        for sensor_result, offs in ((result, with_misfit), (trusted, without)):
            found = vibrident.correct(sensor_result, noisy).corrections[0].peak
            offs.append((found.value - peak) / found.standard_uncertainty)
    assert np.mean(np.abs(with_misfit) < 2.0) > 0.9
    assert np.sqrt(np.mean(np.square(with_misfit))) > 0.2  # and the interval is no excuse for anything
    assert np.sqrt(np.mean(np.square(without))) > 2.0 * np.sqrt(np.mean(np.square(with_misfit)))


def test_every_sample_has_an_uncertainty_that_covers() -> None:
    clean, _ = shock("paper", 1.5e-3, 51200.0)
    truth, rng = SENSORS["paper"], np.random.default_rng(5)
    reference = np.asarray(clean.records[0].reference)
    event = np.abs(reference) > 0.02 * reference.max()
    shares = []
    for seed in range(12):
        result = known_result(truth.model, truth.parameters, DECENT, rng=rng)
        found = vibrident.correct(result, with_noise(clean, response_noise=1e-3, seed=seed)).corrections[0]
        assert np.all(np.isfinite(found.standard_uncertainty))
        assert np.all(found.standard_uncertainty > 0)
        inside = np.abs(found.acceleration - reference) < 1.96 * found.standard_uncertainty
        shares.append((np.mean(inside[event]), np.mean(inside[~event])))
    assert np.all(np.mean(shares, axis=0) > 0.92)


def test_without_noise_the_error_shrinks_with_the_band() -> None:
    """What is left is what the low-pass removes: of a half-sine, less than its own bound, and falling with the band."""
    clean, peak = shock("paper", 1.5e-3, 51200.0)
    result = known_result(SENSORS["paper"].model, SENSORS["paper"].parameters)
    reference, errors = np.asarray(clean.records[0].reference), []
    for high in (1000.0, 2000.0, 4000.0, 8000.0):
        found = vibrident.correct(result, clean, band_hz=(0.0, high)).corrections[0]
        errors.append(np.max(np.abs(found.acceleration - reference)))
        assert errors[-1] < found.bound
    assert np.all(np.diff(errors) < 0)
    assert errors[-1] < 0.01 * peak


@pytest.mark.parametrize(
    ("model", "more"),
    [
        ("accelerometer+delay", {"delay": 2.3e-4}),
        ("accelerometer+highpass", {"highpass_frequency": 5.0}),
        ("accelerometer+mode2", {"mode2_frequency": 3000.0, "mode2_damping": 0.03, "mode2_gain": 0.05}),
        ("accelerometer+highpass+delay", {"highpass_frequency": 0.5, "delay": -1e-4}),
    ],
)
def test_add_ons(model: str, more: dict[str, float]) -> None:
    values = {**SENSORS["paper"].parameters, **more}
    motion = HalfSineShock(10.0, 1.5e-3, 0.012)
    calibration = simulate((model, values), motion, samples=4000, response_noise=1e-3, seed=2)
    found = vibrident.correct(known_result(model, values, DECENT), calibration).corrections[0]
    assert abs(found.peak.value - 10.0) < 3.0 * found.peak.standard_uncertainty
    assert found.peak.standard_uncertainty < 0.05
    assert found.peak.time_s == pytest.approx(0.012 + 0.75e-3, abs=5e-5)
    assert found.integrated_from_rest == model.count("highpass")
    assert found.agreement.within_95_percent > 0.90


def test_a_velocity_pickup_with_a_charge_amplifier_is_integrated_twice() -> None:
    values = {**SENSORS["geophone"].parameters, "highpass_frequency": 0.3}
    model = "velocity-pickup+highpass"
    settings = {"sampling_rate_hz": 2000.0, "samples": 4000, "response_noise": 1e-4}
    errors = []
    for seed in range(8):
        calibration = simulate((model, values), HalfSineShock(1.0, 0.05, 0.4), seed=seed, **settings)
        found = vibrident.correct(known_result(model, values), calibration).corrections[0]
        assert found.integrated_from_rest == 2
        errors.append((found.peak.value - 1.0) / found.peak.standard_uncertainty)
    assert np.sqrt(np.mean(np.square(errors))) < 1.8


def test_invariance_to_units_time_and_polarity() -> None:
    clean, _ = shock("paper", 1.5e-3, 51200.0)
    noisy = with_noise(clean, response_noise=1e-3, seed=1)
    values = dict(SENSORS["paper"].parameters)
    plain = vibrident.correct(known_result("accelerometer", values, DECENT), noisy).corrections[0]
    record = noisy.records[0]
    millivolts = {**values, "sensitivity": -1e3 * values["sensitivity"]}
    turned = vibrident.Record("x", None, -1e3 * record.response, record.sampling_rate_hz, "decay")
    other = vibrident.correct(known_result("accelerometer", millivolts, DECENT), [turned]).corrections[0]
    narrow = vibrident.correct(
        known_result("accelerometer", values, DECENT), noisy, band_hz=(0.0, other.band.high_hz)
    ).corrections[0]
    np.testing.assert_allclose(other.acceleration, narrow.acceleration, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.standard_uncertainty, narrow.standard_uncertainty, rtol=1e-9)
    slow = {**values, "natural_frequency": 0.01 * values["natural_frequency"]}
    stretched = simulate(
        ("accelerometer", slow), HalfSineShock(9.80665, 0.15, 1.171875), sampling_rate_hz=512.0, samples=4000
    )
    slowly = vibrident.correct(
        known_result("accelerometer", slow, DECENT), with_noise(stretched, response_noise=1e-3, seed=1)
    ).corrections[0]
    assert slowly.band.high_hz == pytest.approx(0.01 * plain.band.high_hz, rel=1e-6)
    assert slowly.peak.value == pytest.approx(plain.peak.value, rel=1e-6)

"""The parts of the uncertainty against plain Monte Carlo and against automatic differentiation."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.corrections import DECENT, known_result

import vibrident
from vibrident.physics.simulation import SENSORS, ChannelNoise, simulate, with_noise
from vibrident.use.correction import PassBand
from vibrident.use.correction.chain import MeasuringChain
from vibrident.use.correction.compensation import Compensation
from vibrident.use.correction.quiet import Baseline, estimate_baseline

RATE, SAMPLES = 2000.0, 1500


def around(spectrum: np.ndarray, rest: int) -> Baseline:
    frequency = np.linspace(0.0, 0.5 * RATE, spectrum.size)
    return Baseline(rest, False, 0.0, 0.0, "", frequency, spectrum, 0.0, "", np.inf)


@pytest.mark.parametrize(
    ("model", "rest", "low"),
    [("accelerometer", 0, 0.0), ("velocity-pickup", 100, 0.0), ("velocity-pickup", 0, 5.0)],
)
@pytest.mark.parametrize("coloured", [False, True])
def test_noise_of_every_sample_is_that_of_simulated_noise(model: str, rest: int, low: float, coloured: bool) -> None:
    gain = "sensitivity" if model == "accelerometer" else "generator_constant"
    values = {gain: 2.0, "natural_frequency": 10.0, "damping_ratio": 0.6}
    sensor = known_result(model, values).to_sensor()
    tilt = np.linspace(0.0, 1.0, 65)
    spectrum = 1e-6 * (1.0 / (0.05 + tilt) if coloured else np.ones(65))
    known = around(spectrum, rest)
    compensation = Compensation.from_baseline(MeasuringChain(sensor), PassBand(low, 40.0, ""), RATE, SAMPLES, known)
    rng = np.random.default_rng(8)
    size = 4 * SAMPLES
    shape = np.sqrt(known.noise(np.fft.rfftfreq(size, 1.0 / RATE)))
    draws = []
    for _ in range(400):
        noise = np.fft.irfft(np.fft.rfft(rng.standard_normal(size)) * shape, size)[:SAMPLES]
        draws.append(compensation.restored(compensation.spectrum(noise)))
    inner = slice(600, 900) if low else slice(300, 1200)
    found = np.std(draws, axis=0)[inner]
    # 400 draws tell a standard deviation to 3.5 %; neighbouring samples hardly add to that.
    np.testing.assert_allclose(found / compensation.noise_deviation[inner], 1.0, atol=0.16)
    assert np.mean(found / compensation.noise_deviation[inner]) == pytest.approx(1.0, abs=0.06)


def test_integrated_noise_grows_from_the_first_sample() -> None:
    values = {"generator_constant": 2.0, "natural_frequency": 50.0, "damping_ratio": 0.6}
    sensor = known_result("velocity-pickup", values).to_sensor()
    compensation = Compensation.from_baseline(
        MeasuringChain(sensor), PassBand(0.0, 10.0, ""), RATE, SAMPLES, around(np.full(9, 1e-6), 100)
    )
    noise = compensation.noise_deviation
    assert np.all(np.diff(noise) >= 0)
    # ωn²/G ∫ y dt dominates late: √(t Ts) times the white noise's deviation
    late = (2 * np.pi * 50.0) ** 2 / 2.0 * np.sqrt(SAMPLES) / RATE * 1e-3
    assert noise[-1] == pytest.approx(late, rel=0.05)


@pytest.mark.draws(50, 200)
def test_parameters_with_their_correlation_reach_every_sample(draws: int) -> None:
    """The model's part of u against redrawn parameters, strongly correlated; noise-free record."""
    values = dict(SENSORS["paper"].parameters)
    matrix = np.array([[1.0, -0.8, 0.3], [-0.8, 1.0, 0.1], [0.3, 0.1, 1.0]])
    calibration = simulate("paper", "shock", samples=1200)
    stated = known_result("accelerometer", values, DECENT, matrix)
    band = (0.0, 4000.0)
    found = vibrident.correct(stated, calibration, band_hz=band, noise=1e-9).corrections[0]
    rng = np.random.default_rng(2)
    drawn = [
        vibrident.correct(
            known_result("accelerometer", values, DECENT, matrix, rng), calibration, band_hz=band, noise=1e-9
        )
        .corrections[0]
        .acceleration
        for _ in range(draws)
    ]
    scatter = np.std(drawn, axis=0)
    moving = found.components["model"] > 0.1 * found.components["model"].max()
    four_deviations = 4.0 / np.sqrt(2 * draws)
    np.testing.assert_allclose(scatter[moving] / found.components["model"][moving], 1.0, atol=four_deviations)
    whole = np.sqrt(np.sum(scatter**2)), np.sqrt(np.sum(found.components["model"] ** 2))
    assert whole[0] == pytest.approx(whole[1], rel=0.75 * four_deviations)


@pytest.mark.parametrize("kind", ["sine", "random"])
def test_a_record_from_the_middle_of_a_motion(kind: str) -> None:
    """Its ends are uncertain and say so; further in, noise alone governs."""
    rates = []
    for seed in range(6):
        calibration = simulate(
            "paper", kind, frequencies_hz=[80.0, 400.0], samples=6000, start="steady", response_noise=1e-3, seed=seed
        )
        result = known_result("accelerometer", SENSORS["paper"].parameters)
        for found in vibrident.correct(result, calibration).corrections:
            reference = np.asarray(found.record.reference)
            off = np.abs(found.acceleration - reference)
            u = found.standard_uncertainty
            assert u[0] > 10.0 * np.median(u)
            assert u[-1] > 10.0 * np.median(u)
            assert np.median(u) < 0.01 * np.std(reference)
            rates.append(
                [np.mean(off[part] < 1.96 * u[part]) for part in (slice(60), slice(1500, 4500), slice(-60, None))]
            )
    assert np.all(np.mean(rates, axis=0) > [0.75, 0.9, 0.75])


def test_hum_and_offset_before_a_shock_are_counted() -> None:
    noise = ChannelNoise(white=1e-3, offset=0.4, flicker=3e-3)
    result = known_result("accelerometer", SENSORS["paper"].parameters)
    clean, z = simulate("paper", "shock", samples=8000), []
    for seed in range(20):
        found = vibrident.correct(result, with_noise(clean, response_noise=noise, seed=seed))
        only = found.corrections[0]
        assert only.baseline.offset == pytest.approx(0.4 * np.std(only.record.response), rel=0.1)
        z.append((only.peak.value - 9.80665) / only.peak.standard_uncertainty)
    assert np.sqrt(np.mean(np.square(z))) < 1.5


def test_noise_level_before_a_shock() -> None:
    calibration = simulate("paper", "shock", samples=8000, response_noise=ChannelNoise(white=2e-3, unit="channel"))
    known = estimate_baseline(calibration.records[0])
    assert known.rest_samples > 600
    assert known.rests_at_end
    assert known.noise_deviation == pytest.approx(2e-3, rel=0.1)
    calm = simulate(
        "paper", "sine", frequencies_hz=[100.0], samples=8000, response_noise=ChannelNoise(white=2e-3, unit="channel")
    )
    assert estimate_baseline(calm.records[0]).noise_deviation == pytest.approx(2e-3, rel=0.15)


def test_quantisation_is_noise_even_where_the_rest_is_dead_still() -> None:
    calibration = simulate("paper", "shock", samples=4000, response_noise=ChannelNoise(full_scale=2.0, bits=10))
    known = estimate_baseline(calibration.records[0])
    assert known.noise_deviation == pytest.approx(2.0 * 2.0**-9 / np.sqrt(12.0), rel=1e-6)

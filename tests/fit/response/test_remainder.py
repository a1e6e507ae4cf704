"""What of a residual is coherent with the prediction, by bands."""

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Record
from vibrident.fit.response.remainder import coherent_remainder
from vibrident.physics.simulation import simulate


def records(rng, error=0.0, samples=4000):
    y = np.convolve(rng.standard_normal(samples), np.hanning(9), "same")
    return Record("r", y, y * (1 + error) + 0.1 * np.std(y) * rng.standard_normal(samples), 1e4, "random"), y


def test_an_error_of_the_prediction_is_found_in_every_band(rng):
    """The response is 5 % larger than predicted: ρ = 0.05 within its stated deviation, χ² as it should be."""
    record, predicted = records(rng, 0.05)
    frequency, rho, deviation, freedom = coherent_remainder(record, predicted)
    assert len(frequency) > 20
    normal = np.concatenate([(rho.real - 0.05) / deviation, rho.imag / deviation])
    factor = np.mean(freedom / (freedom - 2))  # of a variance from few lines
    assert np.mean(normal**2) / factor == pytest.approx(1.0, abs=3 * np.sqrt(2 / len(normal)) * 1.3)


def test_the_deviation_is_that_of_the_scatter(rng):
    """200 right predictions: the mean of |ρ|²/2s² is ν/(ν − 2), within three standard errors."""
    ratios = []
    for _ in range(200):
        record, predicted = records(rng, samples=1000)
        _, rho, deviation, freedom = coherent_remainder(record, predicted)
        ratios.append(np.mean(np.abs(rho) ** 2 / (2 * deviation**2) * (1 - 2 / freedom)))
    assert np.mean(ratios) == pytest.approx(1.0, abs=3 * np.std(ratios) / np.sqrt(200))


def test_samples_without_a_prediction_are_left_out(rng):
    record, predicted = records(rng, 0.05)
    predicted = np.array(predicted)
    predicted[:200] = np.nan
    assert np.mean(coherent_remainder(record, predicted)[1].real) == pytest.approx(0.05, abs=0.02)
    predicted[20:] = np.nan
    assert coherent_remainder(record, predicted) is None


def test_noise_that_grows_while_a_sweep_rises_is_no_misfit():
    """The high bands are passed where the record is noisiest: twice the mean's variance, in the high third of bands."""
    rng, n, rate = np.random.default_rng(4), 4000, 1000.0
    t = np.arange(n) / rate
    predicted = np.sin(2.0 * np.pi * 2.0 * t[-1] / np.log(100.0) * (np.exp(t / t[-1] * np.log(100.0)) - 1.0))
    growing = np.linspace(0.5, 1.5, n)
    ratios = []
    for _ in range(20):
        response = predicted + 0.01 * growing * rng.standard_normal(n)
        record = Record(
            name="s", reference=predicted, response=response, sampling_rate_hz=rate, excitation="sweep"
        )  # fmt: skip
        found = coherent_remainder(record, predicted)
        assert found is not None
        frequency, rho, deviation, freedom = found
        high = frequency > 100.0
        ratios.append(np.abs(rho[high]) ** 2 / deviation[high] ** 2 / 2.0 * (1.0 - 2.0 / freedom[high]))
    assert 0.8 < np.mean(np.concatenate(ratios)) < 1.25


def test_where_noise_grows_the_mean_square_of_a_deviation_is_one():
    """Lines of such noise are alike, so that a band has fewer independent ones than lines; it was 1.11."""
    rng, t = np.random.default_rng(1), np.arange(1000) / 1000.0
    fade = np.sin(0.5 * np.pi * np.clip(np.minimum(t, 0.95 - t) / 0.05, 0.0, 1.0)) ** 2
    predicted = fade * np.sin(2.0 * np.pi * 5.0 / np.log(40.0) * (40.0**t - 1.0))
    growing, squares = np.linspace(0.5, 1.5, t.size), []
    for _ in range(200):
        noise = 0.005 * np.std(predicted) * growing * rng.standard_normal(t.size)
        found = coherent_remainder(Record("r", predicted, predicted + noise, 1000.0, "sweep"), predicted.copy())
        assert found is not None
        _, rho, deviation, freedom = found
        squares.append(np.mean(np.abs(rho) ** 2 / (2.0 * deviation**2) * (1.0 - 2.0 / freedom)))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.05)


def motion(rng, level, samples=1000):
    """Random motion of this level at each frequency of a period 1.37 times as long: it is cut off at both ends."""
    lines = np.arange(1, int(1.37 * samples) // 2)
    size = level(lines / (1.37 * samples)) * (rng.normal(size=(2, lines.size)).T @ [1.0, 1.0j])
    spectrum = np.concatenate([[0.0], size, np.zeros(1)])
    return np.fft.irfft(spectrum, int(1.37 * samples))[:samples]


@pytest.mark.parametrize("unknown", [0, 24])
def test_bands_without_motion_say_nothing(rng, unknown):
    """What leaks there fits any model, as residual and prediction leak alike: half of the points lay there."""
    for _ in range(10):
        predicted = motion(rng, lambda f: f < 0.2)
        response = predicted + 1e-4 * np.std(predicted) * rng.standard_normal(1000)
        record = Record("r", predicted.copy(), response, 1.0, "random")
        predicted[:unknown] = predicted[1000 - unknown :] = np.nan
        frequency, *_ = coherent_remainder(record, predicted)
        assert np.max(frequency) < 0.22
        assert len(frequency) > 20


def test_an_error_is_found_in_full_where_a_resonance_leaks_over_the_band(rng):
    """More leaks there than there is: without a window an error of 5 % seems to be far smaller."""
    errors, squares = [], []
    for _ in range(40):
        low, high = motion(rng, lambda f: 300.0 * (abs(f - 0.02) < 0.001)), motion(rng, lambda f: f > 0.04)
        response = low + 1.05 * high + 0.01 * np.std(high) * rng.standard_normal(1000)
        record = Record("r", low, response, 1.0, "random")
        frequency, rho, deviation, freedom = coherent_remainder(record, low + high)
        there = (frequency > 0.05) & (frequency < 0.1)
        errors.append(np.mean(rho[there].real))
        squares.append(np.mean(np.abs(rho - 0.05) ** 2 / (2 * deviation**2) * (1 - 2 / freedom), where=there))
    assert np.mean(errors) == pytest.approx(0.05, abs=0.003)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


def test_a_wrong_prediction_loses_no_band_that_the_response_passes():
    """A displacement taken for an acceleration: nothing was left to judge the fit by."""
    sensor = ("accelerometer", {"sensitivity": 0.104, "natural_frequency": 300.0, "damping_ratio": 0.7})
    shape = {"frequencies_hz": [20.0, 1500.0], "samples": 4000, "sampling_rate_hz": 12800.0, "quantity": "displacement"}
    made = simulate(sensor, "sweep", response_noise=1e-3, seed=5, **shape)
    result = vibrident.identify(replace(made, quantity="acceleration"))
    assert "lack_of_fit" in result.warning_codes
    assert result.fit.degrees_of_freedom > 20

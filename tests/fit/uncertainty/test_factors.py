"""Measured over modelled response by bands: laws of the factors at the bins of a fit, and of the shares of power."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

import vibrident
from vibrident.data.records import Record
from vibrident.fit.descent.weighted_bins import PredictedRecord, WeightedBins, weighted_records
from vibrident.fit.response.transform import about_mean
from vibrident.fit.uncertainty.explained import powers, shares_of
from vibrident.fit.uncertainty.factors import band_factors
from vibrident.physics.simulation import simulate

P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
MOTIONS = ("random", "sweep", "multisine", "shock")


def weighed(record: Record, predicted: np.ndarray) -> WeightedBins:
    """A record beside its prediction, weighted by the noise that it shows."""
    (bins,) = weighted_records([PredictedRecord(0, record, predicted)])
    return bins


def factors(record: Record, predicted: np.ndarray, *, sine: bool = False):
    return band_factors(weighed(record, predicted), sine=sine)


def records(rng, error=0.0, samples=4000):
    """A right prediction of random motion but for a relative error, in 10 % of white noise."""
    y = np.convolve(rng.standard_normal(samples), np.hanning(9), "same")
    return Record("r", y, y * (1 + error) + 0.1 * np.std(y) * rng.standard_normal(samples), 1e4, "random"), y


@pytest.mark.parametrize("error", [0.05, 0.05j])
def test_a_factor_of_the_response_is_found_in_every_band(rng, error):
    """Larger by 5 %, or turned by 0.05 rad: ρ is that within its stated deviation."""
    record, predicted = records(rng)
    lines = np.fft.rfft(record.response)
    moved = np.fft.irfft(lines + error * np.fft.rfft(predicted), predicted.size)
    found = factors(replace(record, response=moved), predicted)
    assert found is not None
    assert len(found.rho) > 20
    off = (found.rho - error) / found.deviation
    normal = np.concatenate([off.real, off.imag])
    assert np.mean(normal**2) == pytest.approx(1.0, abs=3 * np.sqrt(2 / len(normal)) * 1.3)


def test_squares_of_right_predictions_are_chi2(rng):
    """200 right predictions: squares, |ρ|²/s² and their scatter are those of two degrees of freedom each."""
    squares, ratios, sums = [], [], []
    for _ in range(200):
        found = factors(*records(rng, samples=1000))
        shrink = 1.0 - 2.0 / found.freedom
        squares.append(np.mean(found.squares * shrink))
        ratios.append(np.mean(np.abs(found.rho) ** 2 / found.deviation**2 * shrink))
        sums.append(np.sum(found.squares) / np.sqrt(4.0 * len(found.squares)))
    assert np.mean(squares) == pytest.approx(2.0, abs=3 * np.std(squares) / np.sqrt(200) + 0.03)
    assert np.mean(ratios) == pytest.approx(2.0, abs=3 * np.std(ratios) / np.sqrt(200) + 0.03)
    assert np.std(sums) == pytest.approx(1.0, abs=0.25)


def test_a_factor_scales_with_neither_channel_nor_unit(rng):
    record, predicted = records(rng, 0.05)
    found = factors(record, predicted)
    scaled = factors(replace(record, response=1e-6 * record.response), 1e-6 * predicted)
    np.testing.assert_allclose(scaled.rho, found.rho, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(scaled.squares, found.squares, rtol=1e-6)


def test_samples_without_a_prediction_are_left_out(rng):
    """A third that does not count changes nothing; a record of a few samples says nothing."""
    record, predicted = records(rng, 0.05)
    known = np.where(np.arange(4000) < 1000, np.nan, predicted)
    part = Record("r", record.reference[1000:], record.response[1000:], 1e4, "random")
    alone, seen = factors(part, predicted[1000:]), factors(record, known)
    for each in ("place", "squares", "freedom"):
        np.testing.assert_allclose(getattr(seen, each), getattr(alone, each), rtol=1e-9)


def test_a_straight_drift_is_no_deviation():
    """It is a nuisance of every fit: its ends, which jump, leak into all bands of a shock, that agree in phase."""
    rng, n = np.random.default_rng(4), 2000
    motion, noise = np.exp(-(((np.arange(n) - 300.0) / 20.0) ** 2)), 1e-3 * rng.standard_normal(n)
    more = {"name": "r", "sampling_rate_hz": 1000.0, "excitation": "shock", "reference": motion}
    still, drifting = (
        factors(Record(response=motion + noise + slow, **more), motion) for slow in (0.0, np.linspace(0.0, 0.05, n))
    )
    np.testing.assert_allclose(drifting.squares, still.squares, rtol=1e-2)


@pytest.mark.parametrize("growth", [0.0, 0.25, 0.5])
@pytest.mark.quick("0.0", "0.5")
def test_where_noise_grows_the_mean_square_of_a_deviation_is_no_more_than_one(growth):
    """A sweep passes its high bands where the record is noisiest: twice the mean's variance in the high third.

    Bands that move where the record is quiet are compared with its mean.
    """
    rng, t = np.random.default_rng(1), np.arange(2000) / 1000.0
    fade = np.sin(0.5 * np.pi * np.clip(np.minimum(t, 1.95 - t) / 0.05, 0.0, 1.0)) ** 2
    predicted = fade * np.sin(2.0 * np.pi * 10.0 / np.log(40.0) * (40.0 ** (t / 2.0) - 1.0))
    level, squares, high = np.linspace(1.0 - growth, 1.0 + growth, t.size), [], []
    for _ in range(100):
        noise = 0.005 * np.std(predicted) * level * rng.standard_normal(t.size)
        found = factors(Record("r", predicted, predicted + noise, 1000.0, "sweep"), predicted.copy())
        squares.append(np.mean(found.squares / 2.0 * (1.0 - 2.0 / found.freedom)))
        high.append(np.mean((found.squares / 2.0 * (1.0 - 2.0 / found.freedom))[found.place > 200.0]))
    assert (0.7 if growth else 0.92) < np.mean(squares) < 1.08
    assert np.mean(high) == pytest.approx(1.0, abs=0.15)


def test_a_sine_has_one_factor(rng):
    t = np.arange(2000) / 10e3
    tone = np.sin(2 * np.pi * 437.0 * t)
    record = Record("s", tone, 1.02 * tone + 0.01 * rng.standard_normal(2000), 10e3, "sine")
    found = factors(record, tone, sine=True)
    assert found.rho.shape == (1,)
    assert found.place[0] * 5.0 == pytest.approx(437.0, abs=10.0)
    assert abs(found.rho[0] - 0.02) < 4.0 * found.deviation[0]
    assert found.deviation[0] == pytest.approx(0.01 / np.sqrt(1000.0), rel=0.15)


# What the model explains, and what any linear sensor could


def shares(records, predicted):
    parts = []
    for record, series in zip(records, predicted, strict=True):
        bins = weighed(record, series)
        about_means = (signal - signal.mean() for signal in (record.reference, record.response))
        parts.append(powers(bins, *about_means, 0.0, slice(1, 400)))
    return shares_of(parts)


def noisy(excitation, noise, rng, share=0.0):
    made = simulate(
        ("accelerometer", P), excitation, samples=1000, sampling_rate_hz=10e3, repeats=3, seed=int(rng.integers(1000))
    )
    found, predicted = [], []
    for record in made.records:
        own = noise * share * np.std(record.reference) * rng.standard_normal(record.samples)
        y = record.response + noise * np.std(record.response) * rng.standard_normal(record.samples)
        found.append(replace(record, reference=record.reference + own, response=y))
        predicted.append(record.response - own * 0.104)
    return found, predicted


@pytest.mark.parametrize("excitation", MOTIONS)
@pytest.mark.parametrize("noise", [1e-4, 0.03, 0.5, 1.5])
def test_a_right_model_explains_what_is_coherent(excitation, noise, rng):
    """Noise of either channel, up to twice the power of the response; lacking in none of 4 calibrations."""
    for _ in range(4):
        found = shares(*noisy(excitation, noise, rng, rng.choice([0.0, 0.3])))
        assert not found.lacking, found
        assert found.coherent < found.explained + max(0.1, 0.3 * (1.0 - found.explained)), found


def test_a_resonance_narrower_than_a_block_is_coherent_where_the_model_explains_it():
    """The coherent share was 0.33 beside 1.0 explained: no smooth response has so sharp a resonance."""
    sharp = {**P, "natural_frequency": 1500.0, "damping_ratio": 0.002}
    made = simulate(("accelerometer", sharp), "shock", samples=1000, sampling_rate_hz=10e3, response_noise=1e-3, seed=4)
    fit = vibrident.identify(made).fit
    assert fit.explained > 0.999
    assert fit.explained <= fit.coherent <= 1.0


@pytest.mark.parametrize("excitation", MOTIONS)
@pytest.mark.parametrize("wrong", ["nothing", "late", "half"])
def test_a_model_that_leaves_the_motion_is_lacking(excitation, wrong, rng):
    """A prediction of nothing, one that is 30 samples late, and half of the response, with 1 % of noise."""
    records, _ = noisy(excitation, 0.01, rng)
    made = {"nothing": lambda y: 0.0 * y, "late": lambda y: np.roll(y, 30), "half": lambda y: 0.5 * y}[wrong]
    found = shares(records, [made(r.response) for r in records])
    assert found.lacking
    assert found.coherent > 0.9


def test_channels_that_have_nothing_in_common_have_no_coherent_share(rng):
    x, y = rng.standard_normal((2, 4000))
    found = shares([Record("r", x, y, 1e4, "random")], [0.0 * x])
    assert found.coherent < 0.1
    assert found.explained < 0.01
    assert found.lacking


@pytest.mark.slow
def test_a_fit_that_explains_nothing_of_a_shock_is_not_adequate():
    """The response comes 30 samples late and the model has no delay: its own residual was taken for the noise."""
    trial = BY_NAME["lacking/delay/in-light+delay=30/shock/0.1 %"].trial(2)
    result = vibrident.identify(trial.calibration(), model=trial.model)
    assert not result.fit.adequate
    assert "lack_of_fit" in result.warning_codes


def test_a_series_of_which_nothing_is_used_is_zero_about_its_mean():
    """A delay can leave no sample of a record: the mean of none is no Python warning."""
    series = np.arange(5.0)
    assert about_mean(series, np.zeros(5, dtype=bool)).tolist() == [0.0] * 5
    assert about_mean(series, np.arange(5) > 2).tolist() == [0.0, 0.0, 0.0, -0.5, 0.5]


@pytest.mark.slow
def test_a_record_of_which_a_delay_leaves_nothing_raises_no_warning():
    """Three cuts in both channels leave a piece that is shorter than the delay that is found in it."""
    trial = BY_NAME["defect/cuts of both channels:3/mixed/below-light/0.1 %"].trial(29)
    assert "clock_suspect" in vibrident.identify(trial.calibration(), model=trial.model).warning_codes


def test_a_wrong_prediction_loses_no_band_that_the_response_passes():
    """A displacement taken for an acceleration: nothing was left to judge the fit by."""
    sensor = ("accelerometer", {"sensitivity": 0.104, "natural_frequency": 300.0, "damping_ratio": 0.7})
    shape = {"frequencies_hz": [20.0, 1500.0], "samples": 4000, "sampling_rate_hz": 12800.0, "quantity": "displacement"}
    made = simulate(sensor, "sweep", response_noise=1e-3, seed=5, **shape)
    result = vibrident.identify(replace(made, quantity="acceleration"))
    assert "lack_of_fit" in result.warning_codes


def test_shares_are_in_the_result():
    made = simulate(("accelerometer", P), "random", samples=4000, sampling_rate_hz=10e3, response_noise=0.3, seed=1)
    fit = vibrident.identify(made).fit
    assert fit.explained == pytest.approx(fit.coherent, abs=0.03)
    assert 0.85 < fit.explained < 0.99


def test_of_a_sine_only_bins_with_motion_are_looked_at(rng):
    """Beside hum near its frequency nuisances were of any size elsewhere, and a right model explained 0 %."""
    t = np.arange(1000) / 10e3
    tone = np.sin(2 * np.pi * 400.0 * t)
    record = Record("s", tone, tone + 0.01 * rng.standard_normal(1000), 10e3, "sine")
    bins = weighed(record, tone)
    near = np.abs(np.arange(bins.residual.size) - 40) < 4
    garbage = np.where(near, 0.0, 1e6 / (1.0 + np.arange(bins.residual.size)))
    bins = replace(bins, residual=bins.residual + garbage, spectrum=replace(bins.spectrum, excited=1.0 * near))
    parts = powers(bins, tone, tone, 0.0, slice(1, 400), where_excited=True)
    assert shares_of([parts]).explained > 0.99


def test_what_any_sensor_could_explain_does_not_depend_on_nuisances(rng):
    """Those of an oscillator that never stops were ten times the response: none of it looked coherent."""
    [record, *_], [predicted, *_] = noisy("random", 0.01, rng)
    bins = weighed(record, predicted)
    ringing = 30.0 * np.abs(bins.predicted).max() / (1.0 + np.abs(np.arange(bins.predicted.size) - 90.3))
    away = replace(bins, predicted=bins.predicted + ringing, residual=bins.residual + ringing)
    band = slice(1, 400)
    right, wrong = (shares_of([powers(b, record.reference, record.response, 0.0, band)]) for b in (bins, away))
    assert wrong.coherent == pytest.approx(right.coherent, abs=0.02)


def test_bins_that_do_not_count_have_no_say(rng):
    """Nuisances are of any size there: behind eight bits no band of a sweep showed enough motion beside them."""
    bins = weighed(*records(rng))
    inner = np.arange(bins.residual.size) < bins.residual.size // 2
    limited = replace(bins, counts=bins.counts * inner)
    wild = replace(limited, predicted=np.where(inner, bins.predicted, 1e6 * bins.predicted))
    expected, among_wild = (band_factors(each, sine=False) for each in (limited, wild))
    np.testing.assert_allclose(among_wild.rho, expected.rho)
    np.testing.assert_allclose(among_wild.squares, expected.squares)


def test_sines_of_less_than_a_period_do_not_hide_what_the_others_show() -> None:
    """The amplitude of 0.8 periods may be of any size: a right model explained 3 %."""
    trial = BY_NAME["extreme/0.8 periods/below-damped"].trial(153)
    fit = vibrident.identify(trial.calibration(), model=trial.model).fit
    assert fit.explained > 0.99
    assert fit.coherent > 0.99

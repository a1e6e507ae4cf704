"""The banded response, and the remainder of a residual that is coherent with a prediction."""

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.measure import measure_bands
from vibrident.measure.bands import band_edges, coherent_remainder, uncorrelated_records
from vibrident.models import parse
from vibrident.records import Record
from vibrident.simulation import HalfSineShock, simulate

P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}


@pytest.mark.parametrize(
    ("excitation", "within"), [("random", 0.05), ("sweep", 0.1), ("multisine", 0.05), ("shock", 0.1)]
)
def test_bands_show_the_sensor(excitation, within):
    """Good enough for start values: median of |H/H_true − 1| a few per cent, over a decade of frequency at least."""
    record = simulate(("accelerometer", P), excitation, samples=8000, sampling_rate_hz=10e3, seed=3).records[0]
    found = measure_bands([record])
    true = parse("accelerometer").frequency_response(P, found.frequency_hz)
    assert np.median(np.abs(found.ratio / true - 1)) < within
    assert found.frequency_hz.max() > 10 * found.frequency_hz.min()


@pytest.mark.parametrize("quantity", ["velocity", "displacement"])
@pytest.mark.parametrize("excitation", ["random", "sweep", "shock"])
def test_low_frequencies_of_a_displacement_do_not_leak_over_the_others(quantity, excitation):
    """Nor does what a shock moved the sensor by in the end."""
    motion = {"samples": 8000, "sampling_rate_hz": 10e3, "quantity": quantity}
    record = simulate(("accelerometer", P), excitation, response_noise=1e-6, seed=3, **motion).records[0]
    found = measure_bands([record], quantity)
    true = parse("accelerometer").frequency_response(P, found.frequency_hz, quantity)
    assert np.median(np.abs(found.ratio / true - 1)) < 0.02
    assert found.frequency_hz.max() > 800.0


@pytest.mark.parametrize("excitation", ["random", "sweep", "shock", "multisine"])
def test_a_record_without_the_motion_is_told_from_one_full_of_noise(excitation):
    """A dead channel in one of three records, 20 times each; noise of 30 % of the response is no dead channel."""
    made = simulate(("accelerometer", P), excitation, samples=1000, sampling_rate_hz=10e3, repeats=3, seed=3).records
    rng, missed = np.random.default_rng(1), 0
    for trial in range(20):
        noisy = [r.with_response(r.response + 0.3 * np.std(r.response) * rng.standard_normal(1000), "") for r in made]
        assert uncorrelated_records(measure_bands(noisy)) == []
        dead = rng.standard_normal(1000)
        one = replace(made[1], reference=dead) if trial % 2 else made[1].with_response(dead, "")
        missed += uncorrelated_records(measure_bands([made[0], one, made[2]])) != [1]
    assert missed <= 1


FAR_ABOVE = {"sensitivity": 0.1, "natural_frequency": 150.0, "damping_ratio": 0.02, "delay": 300.3e-4}
RINGING = {"sensitivity": 0.1, "natural_frequency": 1300.0, "damping_ratio": 0.001, "delay": 0.0}


@pytest.mark.parametrize("p", [FAR_ABOVE, RINGING])
@pytest.mark.parametrize("rest", [0.0, 0.45])
def test_free_motion_and_a_late_response_hide_no_motion(p, rest):
    """Records of 1000 samples that begin in the middle of free motion, or of a motion after rest, late by up to 300.

    Free motion at the natural frequency is up to a hundred times the response at the others.
    """
    motion = {"frequencies_hz": (50.0, 2000.0), "samples": 1450, "sampling_rate_hz": 10e3, "repeats": 8}
    made = simulate(("accelerometer+delay", p), "random", response_noise=1e-3, **motion, seed=4).records
    begin = 0 if rest else 450  # simulated records begin at rest
    still = np.zeros(int(1000 * rest))
    cut = []
    for record in made:
        channels = [
            np.concatenate([still + 1e-3 * np.std(v) * np.random.default_rng(1).standard_normal(still.size), v[begin:]])
            for v in (record.reference, record.response)
        ]
        cut.append(replace(record, reference=channels[0][:1000], response=channels[1][:1000], valid=None))
    found = measure_bands(cut)
    true = parse("accelerometer+delay").frequency_response(p, found.frequency_hz)
    assert uncorrelated_records(found) == []
    assert np.median(np.abs(found.ratio / true - 1.0)) < 0.15


def test_nothing_without_a_reference_or_motion():
    decay = simulate(("accelerometer", P), "decay", samples=1000).records
    assert measure_bands(decay) is None
    flat = Record("flat", np.zeros(100), np.sin(np.arange(100)), 1e3, "random")
    assert measure_bands([flat]) is None


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


@pytest.mark.parametrize("samples_late", [-30, 30, 800])
@pytest.mark.parametrize("motion", ["random", "sweep"])
def test_a_response_that_comes_late_is_moved_back_before_bands_are_taken(motion, samples_late):
    """Late by a tenth of the record, phases turn by whole turns within a band; the response is measured still."""
    p = {"sensitivity": 0.1, "natural_frequency": 2000.0, "damping_ratio": 0.3, "delay": (samples_late + 0.3) / 51200.0}
    made = simulate(
        ("accelerometer+delay", p), motion, frequencies_hz=(50.0, 8000.0), sampling_rate_hz=51200.0, samples=8000,
        amplitude=10.0, response_noise=1e-3, seed=5,
    )  # fmt: skip
    found = measure_bands(made.records)
    expected = parse("accelerometer+delay").frequency_response(p, found.frequency_hz)
    assert found.points > 20
    assert np.median(np.abs(found.ratio / expected - 1.0)) < 0.03


def test_every_band_has_lines_enough_to_tell_its_noise():
    """Whatever the length of a record."""
    assert min(np.min(np.diff(band_edges(samples, 1e3))) for samples in range(40, 4000)) >= 3


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


def test_free_motion_hides_the_delay_of_a_record_and_not_that_of_all(rng):
    """Shocks that come 300 samples late to a sensor that still rings with a third of their response."""
    values = {"sensitivity": 1e-5, "natural_frequency": 118.0, "damping_ratio": 0.028, "delay": 0.03}
    shocks = [HalfSineShock(100.0 * (1 + number % 3), 1.2e-3, 0.025) for number in range(6)]
    made = simulate(
        ("accelerometer+delay", values), shocks, samples=1000, sampling_rate_hz=1e4, response_noise=1e-3, seed=3
    )
    ringing, turn = [], 2.0 * np.pi * 118.0 * np.arange(1000) / 1e4
    for record in made.records:
        free = np.exp(-0.028 * turn) * np.cos(np.sqrt(1.0 - 0.028**2) * turn + rng.uniform(0.0, 2.0 * np.pi))
        ringing.append(replace(record, response=record.response + 0.5 * np.max(np.abs(record.response)) * free))
    result = vibrident.identify(replace(made, records=tuple(ringing)))
    for name, true in values.items():
        known = result.parameters[name]
        assert abs(known.value - true) < 4.0 * known.standard_uncertainty
    assert result.warning_codes == ()

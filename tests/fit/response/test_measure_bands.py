"""The banded response, and the remainder of a residual that is coherent with a prediction."""

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Record
from vibrident.fit.response import measure_bands
from vibrident.fit.response.bands import MAX_FALSE_FRACTION, band_edges, uncorrelated_records
from vibrident.physics.models import parse
from vibrident.physics.simulation import HalfSineShock, simulate

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


def test_bands_that_hold_only_the_noise_of_both_channels_are_left_out():
    """Motion below a fifth of half the rate, noise beyond: of the bands that are kept one in a hundred is noise."""
    made = simulate(
        ("accelerometer", P), "random", frequencies_hz=[10.0, 1000.0], samples=1000, sampling_rate_hz=10e3, repeats=8,
        seed=3,
    ).records  # fmt: skip
    rng, kept, noise = np.random.default_rng(2), 0, 0
    for _ in range(25):
        noisy = [r.with_response(r.response + 0.03 * np.std(r.response) * rng.standard_normal(1000), "") for r in made]
        for k, r in enumerate(noisy):
            noisy[k] = replace(r, reference=r.reference + 0.03 * np.std(r.reference) * rng.standard_normal(1000))
        frequency = measure_bands(noisy).frequency_hz
        kept += frequency.size
        noise += np.count_nonzero(frequency > 1100.0)
    assert kept > 25 * 8 * 15
    assert noise <= MAX_FALSE_FRACTION * kept

"""Uncertainty of every sample where the record shows more than white noise, and motion at a record's ends."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter
from tests.support.corrections import DECENT, known_result

import vibrident
from vibrident.physics.simulation import HalfSineShock, Sine, simulate

SENSORS = {
    "accelerometer": ({"sensitivity": 1.0, "natural_frequency": 800.0, "damping_ratio": 0.1}, 20e3, 1e-3, 0.02),
    "velocity-pickup": ({"generator_constant": 100.0, "natural_frequency": 10.0, "damping_ratio": 0.6}, 2e3, 0.05, 0.3),
}
PEAK = 500.0


def beside(kind, samples, rate, begin_s, rng):
    """What stands in the response besides the motion, per its peak."""
    k = np.arange(samples)
    hum = 0.01 * np.cos(2 * np.pi * 50.0 * k / rate + rng.uniform(0, 6))
    slow = np.fft.irfft(np.fft.rfft(rng.normal(size=2 * samples)) / np.sqrt(np.arange(samples + 1) + 1.0))[:samples]
    return {
        "white": 0.0,
        "hum": hum,
        "drift": 0.1 * k / samples,
        "shifted zero": 0.01 * (k > begin_s * rate + 8),
        "1/f": 0.003 * slow / np.std(slow),
    }[kind]


def corrected(model, kind, *, begin_s=None, wild=None, samples=1600, seed=0, damping=None):
    values, rate, pulse_s, usual_s = SENSORS[model]
    values = values | ({} if damping is None else {"damping_ratio": damping})
    begin_s = usual_s if begin_s is None else begin_s
    motion = HalfSineShock(PEAK, pulse_s, begin_s)
    record = simulate((model, values), motion, sampling_rate_hz=rate, samples=samples, antialias=False).records[0]
    rng = np.random.default_rng(seed)
    size = np.max(np.abs(record.response))
    noise = 1e-4 * rng.normal(size=samples) + beside(kind, samples, rate, begin_s, rng)
    noisy = record.with_response(record.response + size * noise, "noise")
    if wild is not None:  # a channel, and the index of its wild sample
        channel, index = wild
        odd = np.where(np.arange(samples) == index, 7.0 * np.max(getattr(noisy, channel)), getattr(noisy, channel))
        noisy = replace(noisy, **{channel: odd})
    found = vibrident.correct(known_result(model, values, DECENT, rng=rng), [noisy])
    return found, record.reference


@pytest.mark.parametrize("model", SENSORS)
@pytest.mark.parametrize("kind", ["white", "hum", "drift", "shifted zero", "1/f"])
def test_the_uncertainty_of_every_sample_covers(model, kind):
    inside, off = [], []
    for seed in range(4):
        found, truth = corrected(model, kind, seed=seed)
        one = found.corrections[0]
        inside.append(np.mean(np.abs(one.acceleration - truth) <= 2.0 * one.standard_uncertainty))
        off.append((one.peak.value - PEAK) / one.peak.standard_uncertainty)
        codes = {finding.code for finding in found.findings}
        assert ("drift" in codes) or kind not in ("drift", "shifted zero")
        assert kind != "white" or codes == set()
    assert np.mean(inside) > 0.9
    assert np.max(np.abs(off)) < 4.0


@pytest.mark.parametrize("model", SENSORS)
def test_a_motion_that_begins_with_the_record_is_right_and_said(model):
    found, truth = corrected(model, "white", begin_s=0.0)
    one = found.corrections[0]
    assert one.record.samples == one.acceleration.size == truth.size
    assert abs(one.peak.value - PEAK) < 3.0 * one.peak.standard_uncertainty < 0.02 * PEAK
    assert np.mean(np.abs(one.acceleration - truth) <= 2.0 * one.standard_uncertainty) > 0.9
    assert [finding.code for finding in found.findings] == ["short_record"]


def test_a_ring_down_that_meets_the_last_sample_is_covered_and_said():
    found, truth = corrected("accelerometer", "white", samples=460, damping=0.01)
    one = found.corrections[0]
    assert abs(one.peak.value - PEAK) < 4.0 * one.peak.standard_uncertainty < 0.02 * PEAK
    assert np.mean(np.abs(one.acceleration - truth) <= 2.0 * one.standard_uncertainty) > 0.9
    assert "short_record" in {finding.code for finding in found.findings}


def test_clean_sines_raise_no_warning_of_the_arithmetic():
    values = SENSORS["accelerometer"][0]
    for frequency in (20.0, 160.0, 1000.0, 3000.0):
        made = simulate(("accelerometer", values), Sine(frequency, 1.0), sampling_rate_hz=20e3, samples=2000)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            one = vibrident.correct(known_result("accelerometer", values, DECENT), made).corrections[0]
        assert np.all(np.isfinite(one.standard_uncertainty))


def moved(model, values, motion, samples, rate, noise, seed=0):
    """A correction and its truth: exact for a motion that is straight between the points of a grid 16 times as fine."""
    time = np.arange(16 * samples) / (16 * rate)
    w, damping = 2.0 * np.pi * values["natural_frequency"], values["damping_ratio"]
    above = [values["sensitivity"] * w**2] if model == "accelerometer" else [values["generator_constant"], 0.0]
    (above,), below, _ = cont2discrete((above, [1.0, 2.0 * damping * w, w**2]), time[1], method="foh")
    truth, rng = motion(time), np.random.default_rng(seed)
    response = lfilter(above, below, truth)[::16]
    response += noise * np.max(np.abs(response)) * rng.standard_normal(samples)
    record = vibrident.Record("moved", None, response, rate, "decay")
    one = vibrident.correct(known_result(model, values, DECENT, rng=rng), [record]).corrections[0]
    return one, truth[::16], (one.acceleration - truth[::16]) / one.standard_uncertainty


@pytest.mark.parametrize(
    ("model", "first", "last", "rate"),
    [
        ("accelerometer", 20.0, 1000.0, 20e3),
        ("accelerometer", 20.0, 4000.0, 20e3),
        ("velocity-pickup", 1.0, 80.0, 200.0),
    ],
)
def test_the_ends_of_a_sweep_are_covered(model, first, last, rate):
    """The last of it is faster than all before: it was cut off by the band, or wrong by its end, with u of the rest:
    up to 69 u. The first of it lies below the band of a velocity pickup, whose peak was 4 u off."""
    octaves, span = np.log(last / first), 4000 / rate
    one, _, off = moved(
        model,
        SENSORS[model][0],
        lambda t: 10.0 * np.sin(2.0 * np.pi * first * span / octaves * np.expm1(t / span * octaves)),
        *(4000, rate, 1e-3),
    )
    assert np.mean(np.abs(off) < 2.0) > 0.93
    assert np.max(np.abs(off)) < 4.5
    assert abs(abs(one.peak.value) - 10.0) < 2.0 * one.peak.standard_uncertainty


def test_a_corner_of_the_motion_is_covered():
    """A ringing blow on a broadband seismometer, far above its corner of 120 s: 9 u off where it begins."""
    values = {"generator_constant": 1500.0, "natural_frequency": 1.0 / 120.0, "damping_ratio": 0.707}

    def blow(t):
        later = np.maximum(t - 10.0, 0.0)
        return 0.01 * np.exp(-5.0 * later) * np.sin(20.0 * np.pi * later)

    _, _, off = moved("velocity-pickup", values, blow, 4000, 100.0, 1e-4)
    assert np.mean(np.abs(off) < 2.0) > 0.93
    assert np.max(np.abs(off)) < 4.0


def test_hum_whose_period_is_longer_than_a_part_at_rest_is_covered():
    """A part of 5 ms showed a quarter of a period of 50 Hz, and 66 % of these samples were covered."""
    found, truth = corrected("accelerometer", "hum", begin_s=0.008, seed=8)
    one = found.corrections[0]
    assert np.mean(np.abs(one.acceleration - truth) <= 2.0 * one.standard_uncertainty) > 0.93


@pytest.mark.parametrize("model", SENSORS)
def test_a_wild_sample_of_the_reference_alone_costs_nothing(model):
    index = 460 if model == "accelerometer" else 400
    found, _ = corrected(model, "white", wild=("reference", index))
    clean, _ = corrected(model, "white")
    one = found.corrections[0]
    np.testing.assert_array_equal(one.acceleration, clean.corrections[0].acceleration)
    assert found.findings == clean.findings
    assert one.agreement.within_95_percent > 0.9


@pytest.mark.parametrize("model", SENSORS)
def test_a_wild_sample_of_the_response_costs_its_neighbours(model):
    """Behind it all was unknown where a response is integrated; now the error of the bridge is in the uncertainty."""
    found, truth = corrected(model, "white", wild=("response", 300))
    one = found.corrections[0]
    known = np.isfinite(one.acceleration)
    assert 0 < np.sum(~known) < 0.1 * known.size
    assert np.mean(np.abs(one.acceleration - truth)[known] <= 2.0 * one.standard_uncertainty[known]) > 0.9
    assert abs(one.peak.value - PEAK) < 4.0 * one.peak.standard_uncertainty
    assert {finding.code for finding in found.findings} == {"dead_channel"}


def test_no_peak_is_stated_where_it_is_among_the_samples_that_are_not_known():
    found, _ = corrected("accelerometer", "white", wild=("response", 412))
    assert found.corrections[0].peak is None
    assert "the peak among them" in found.findings[-1].message


def test_lost_time_costs_the_samples_beside_it():
    """Only the longest unbroken part was corrected, as a fit needs it."""
    values = SENSORS["accelerometer"][0]
    made = simulate(("accelerometer", values), "random", sampling_rate_hz=20e3, samples=4000, antialias=False,
                    frequencies_hz=(50.0, 2000.0), response_noise=1e-3, seed=1).records[0]  # fmt: skip
    kept = np.r_[0:1800, 1900:4000]
    broken = replace(made, reference=made.reference[kept], response=made.response[kept], valid=None)
    found = vibrident.correct(known_result("accelerometer", values, DECENT), [broken])
    one = found.corrections[0]
    known = np.isfinite(one.acceleration)
    assert "clock_suspect" in {finding.code for finding in found.findings}
    assert 0.9 < np.mean(known) < 1.0
    off = np.abs(one.acceleration - broken.reference)[known] / one.standard_uncertainty[known]
    assert np.mean(off < 2.0) > 0.9

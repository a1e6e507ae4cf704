"""Uncertainty of every sample where the record shows more than white noise, and motion at a record's ends."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from tests.support.corrections import DECENT, known_result

import vibrident
from vibrident.simulation import HalfSineShock, Sine, simulate

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


def corrected(model, kind, *, begin_s=None, samples=1600, seed=0, damping=None):
    values, rate, pulse_s, usual_s = SENSORS[model]
    values = values | ({} if damping is None else {"damping_ratio": damping})
    begin_s = usual_s if begin_s is None else begin_s
    motion = HalfSineShock(PEAK, pulse_s, begin_s)
    record = simulate((model, values), motion, sampling_rate_hz=rate, samples=samples, antialias=False).records[0]
    rng = np.random.default_rng(seed)
    size = np.max(np.abs(record.response))
    noise = 1e-4 * rng.normal(size=samples) + beside(kind, samples, rate, begin_s, rng)
    noisy = record.with_response(record.response + size * noise, "noise")
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

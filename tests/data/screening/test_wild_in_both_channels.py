"""Wild samples in both channels at once, in longer runs, and at an even distance are left out; nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.screening import screen

N = 6000
GUARD = 4 + 1


def motion(rng: np.random.Generator, damping: float) -> tuple[FloatArray, FloatArray]:
    """Random motion up to 0.2 of the rate, and an oscillator's response at 0.1 of it."""
    f = np.fft.rfftfreq(N)
    lines = np.fft.rfft(rng.standard_normal(N)) * ((f > 0.005) & (f < 0.2))
    response = lines * 0.01 / (0.01 - f**2 + 0.2j * damping * f)
    noise = 1e-3 * rng.standard_normal((2, N))
    reference, response = (np.fft.irfft(each, N) / np.std(np.fft.irfft(each, N)) for each in (lines, response))
    return reference + noise[0], response + noise[1]


def left_out(reference: FloatArray, response: FloatArray) -> BoolArray:
    """The samples that screening leaves out."""
    (record,), _ = screen([Record("r", reference, response, 1000.0, "random")])
    return ~(record.mask & record.reference_mask)


@pytest.mark.parametrize("damping", [0.02, 0.5])
@pytest.mark.parametrize("length", [1, 6, 30, 120])
@pytest.mark.parametrize("size", [5.0, 1e4])
@pytest.mark.draws(2, 20)
def test_a_run_in_both_channels_is_left_out(
    damping: float, length: int, size: float, draws: int, rng: np.random.Generator
) -> None:
    for _ in range(draws):
        channels = motion(rng, damping)
        begin = int(rng.integers(500, N - 1000))
        run = np.zeros(N, dtype=bool)
        run[begin : begin + length] = True
        for values in channels:
            values[run] = size * rng.choice([-1.0, 1.0], length) * rng.uniform(0.5, 1.0, length)
        excluded = left_out(*channels)
        assert excluded[run].all()
        assert excluded.sum() <= length + 2 * GUARD


@pytest.mark.parametrize("damping", [0.02, 0.5])
@pytest.mark.draws(2, 20)
def test_a_knock_that_the_sensor_answers_stays(damping: float, draws: int, rng: np.random.Generator) -> None:
    """Both channels are odd at once, and the response follows from the reference."""
    f = np.fft.rfftfreq(N)
    for _ in range(draws):
        reference, _ = motion(rng, damping)
        begin = int(rng.integers(500, N - 1000))
        reference[begin : begin + 12] += 20.0 * np.hanning(14)[1:-1]
        response = np.fft.irfft(np.fft.rfft(reference) * 0.01 / (0.01 - f**2 + 0.2j * damping * f), N)
        assert not left_out(reference, response + 1e-3 * rng.standard_normal(N)).any()


@pytest.mark.parametrize("size", [5.0, 20.0])
def test_spikes_at_an_even_distance_are_left_out(size: float, rng: np.random.Generator) -> None:
    """Their power is that of the motion: a prediction that has them hides them."""
    reference, response = motion(rng, 0.1)
    spikes = np.zeros(N, dtype=bool)
    spikes[94:-60:100] = True
    reference[spikes] += size
    excluded = left_out(reference, response)
    assert np.array_equal(excluded, spikes)


@pytest.mark.parametrize("place", [0, 1, 9, N - 10, N - 1])
@pytest.mark.parametrize("channel", [0, 1])
def test_a_wild_sample_near_an_end_is_left_out(place: int, channel: int, rng: np.random.Generator) -> None:
    channels = motion(rng, 0.1)
    channels[channel][place] = 1e3
    excluded = left_out(*channels)
    assert excluded[place]
    assert excluded.sum() <= 16 + GUARD


def test_a_sensor_that_begins_at_rest_is_not_wild(rng: np.random.Generator) -> None:
    reference, _ = motion(rng, 0.1)
    f = np.fft.rfftfreq(2 * N)
    shape = 0.01 / (0.01 - f**2 + 0.02j * f)
    response = np.fft.irfft(np.fft.rfft(reference, 2 * N) * shape, 2 * N)[:N]
    assert not left_out(reference, response + 1e-3 * rng.standard_normal(N)).any()


@pytest.mark.parametrize(
    ("case", "run"),
    [
        ("clean/above-damped/sweep/white 1e-6", 145),
        ("clean/above-light+highpass/sweep/white 1e-6", 145),
        ("clean/pickup-below-damped/locked/12 bit", 145),
        ("clean/pickup-below-damped/locked/12 bit", 146),
    ],
)
def test_what_the_rest_of_a_motion_does_not_tell_is_not_wild(case: str, run: int) -> None:
    """The corner where a sweep has faded in; a free motion, whose rounding is new where that of the tone repeats."""
    assert [finding.code for finding in screen(BY_NAME[case].trial(run).calibration().records)[1]] == []


def test_a_run_in_the_response_alone_is_no_corner(rng: np.random.Generator) -> None:
    """The prediction that explains a corner beside the rest of a sweep explains no errors of one channel."""
    record = BY_NAME["clean/above-damped/sweep/white 1e-6"].trial(145).calibration().records[1]
    response = record.response.copy()
    response[400:410] += 1e-2 * np.max(np.abs(response)) * rng.uniform(-1.0, 1.0, 10)
    (screened,), _ = screen([replace(record, response=response)])
    excluded = ~screened.mask
    assert excluded[400:410].all()
    assert excluded.sum() <= 10 + 2 * GUARD

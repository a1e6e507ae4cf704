"""Noise: bands, levels, spectra, quantisation, and the reproducibility of every stream."""

import itertools

import numpy as np
import pytest
from scipy import signal

from vibrident.base.errors import InputError
from vibrident.physics.simulation import ChannelNoise, excitation_noise
from vibrident.physics.simulation.motion import SampleGrid
from vibrident.physics.simulation.scheme import PURPOSES, stream

RATE, SAMPLES = 51200.0, 16000


def felt(rng, **changes):
    return excitation_noise(**({"rms": 0.7, "sampling_rate_hz": RATE, "samples": SAMPLES, "rng": rng} | changes))


@pytest.mark.parametrize("band", [None, (100.0, 5000.0)])
def test_excitation_noise_has_no_content_outside_its_band(rng, band):
    """Over its own period, at twice the record's rate: nothing above the band, to rounding; flat inside."""
    noise = felt(rng, band_hz=band)
    period = round(2 * RATE / noise.tones.fundamental_hz)
    power = np.abs(np.fft.rfft(noise.tones.on(SampleGrid(0.0, 2 * RATE, period)))) ** 2
    f = np.arange(power.size) * noise.tones.fundamental_hz
    low, high = band or (0.0, 0.4 * RATE)
    inside = (f > 0) & (f >= low * (1 - 1e-12)) & (f <= high * (1 + 1e-12))
    assert np.max(power[~inside]) < 1e-24 * np.max(power)
    halves = np.array_split(power[inside], 4)
    np.testing.assert_allclose([np.mean(part) for part in halves], np.mean(power[inside]), rtol=0.1)


def test_excitation_noise_level_is_as_asked():
    """Mean square of 60 records within 4 standard errors (2 √(1/6400/60) = 0.33 %), each within 6 %."""
    values = [
        felt(stream(1, index, "excitation noise"), rms=0.7).tones.on(SampleGrid(0.0, RATE, SAMPLES))
        for index in range(60)
    ]
    power = np.array([np.mean(value**2) for value in values]) / 0.49
    assert abs(np.mean(power) - 1.0) < 0.007
    assert np.max(np.abs(power - 1.0)) < 0.06
    everything = np.concatenate(values)
    assert np.mean(everything**4) / np.mean(everything**2) ** 2 == pytest.approx(3.0, abs=0.03)  # Gaussian


def test_excitation_noise_does_not_repeat_within_the_record(rng):
    noise = felt(rng)
    assert 1.0 / noise.tones.fundamental_hz >= 1.25 * SAMPLES / RATE * (1 - 1e-12)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"band_hz": (0.0, 25600.0)}, "band of the noise"),
        ({"band_hz": (300.0, 200.0)}, "band of the noise"),
        ({"band_hz": (100.0, 100.1)}, "too narrow"),
        ({"rms": -1.0}, "rms"),
        ({"rms": np.nan}, "rms"),
        ({"samples": 0}, "samples"),
    ],
)
def test_excitation_noise_refuses(rng, changes, problem):
    with pytest.raises(InputError) as caught:
        felt(rng, **changes)
    assert problem in caught.value.problem
    assert all((caught.value.expected, caught.value.found, caught.value.where, caught.value.remedy))


SILENCE = np.zeros(2**16)


def drawn(rng, truth=SILENCE, rate=1000.0, **settings):
    return ChannelNoise(**settings).applied(truth, rate, rng)


def test_no_noise_changes_nothing(rng):
    truth = rng.standard_normal(100)
    noise = ChannelNoise()
    np.testing.assert_array_equal(noise.applied(truth, 1000.0, rng), truth)
    assert noise.words == ""


def test_white_noise_is_white_and_of_its_level(rng):
    y = drawn(rng, white=0.3, unit="channel")
    assert np.std(y) == pytest.approx(0.3, rel=0.012)  # 4 standard errors
    _, power = signal.welch(y, 1000.0, nperseg=256)
    np.testing.assert_allclose(power[2:-2], 0.09 / 500.0, rtol=0.3)


def test_levels_relative_to_the_rms(rng):
    truth = 5.0 * np.sin(np.arange(2**16) * 0.1)
    y = drawn(rng, truth, white=0.02) - truth
    assert np.std(y) == pytest.approx(0.02 * 5.0 / np.sqrt(2), rel=0.012)


def test_flicker_falls_like_one_over_f():
    """Mean periodogram of 40 records: slope −1 ± 0.03 over two decades; rms² as asked within 10 %."""
    records = [drawn(stream(2, index, "response"), flicker=0.5, unit="channel") for index in range(40)]
    f, power = signal.welch(np.concatenate(records), 1000.0, "hann", nperseg=2**14)
    edges = np.geomspace(1.0, 300.0, 25)
    parts = [(f >= a) & (f < b) for a, b in itertools.pairwise(edges)]
    centre, level = ([np.mean(values[part]) for part in parts] for values in (f, power))
    slope = np.polyfit(np.log(centre), np.log(level), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.03)
    assert np.mean(np.square(records)) == pytest.approx(0.25, rel=0.1)


def test_hum_stands_at_its_harmonics_alone(rng):
    y = drawn(
        rng, np.zeros(2000), 1000.0, hum=0.2, hum_harmonics=(1.0, 0.0, 0.5), hum_frequency_hz=60.0, unit="channel"
    )
    lines = np.abs(np.fft.rfft(y)) / 1000.0 / np.sqrt(2)  # rms of each line, 0.5 Hz apart
    assert lines[120] == pytest.approx(0.2, rel=1e-9)
    assert lines[360] == pytest.approx(0.1, rel=1e-9)
    assert np.sum(np.delete(lines, [120, 360])) < 1e-9


def test_hum_harmonics_beyond_half_the_rate_are_left_out(rng):
    y = drawn(rng, np.zeros(1200), 120.0, hum=1.0, hum_harmonics=(1.0, 1.0), hum_frequency_hz=50.0, unit="channel")
    assert np.mean(y**2) == pytest.approx(1.0, rel=1e-9)


def test_offset_and_drift(rng):
    y = drawn(rng, offset=1.5, drift=-0.5, unit="channel")
    assert (y[0], y[-1]) == (1.5, 1.0)
    assert np.max(np.abs(np.diff(y, 2))) < 1e-12


def test_quantisation_has_its_step_and_clips(rng):
    """12 bits over ±10: step 4.88 mV, error uniform: rms step/√12 within 1 %; beyond full scale the last code."""
    truth = rng.uniform(-11.0, 11.0, 2**16)
    y = drawn(rng, truth, bits=12, full_scale=10.0)
    step = 10.0 / 2048
    codes = y / step
    assert np.all(codes == np.rint(codes))
    assert (codes.min(), codes.max()) == (-2048, 2047)
    error = (y - truth)[np.abs(truth) < 9.9]
    assert np.max(np.abs(error)) <= step / 2
    assert np.std(error) == pytest.approx(step / np.sqrt(12), rel=0.01)


def test_clipping_without_quantisation(rng):
    truth = rng.uniform(-2.0, 2.0, 1000)
    np.testing.assert_array_equal(drawn(rng, truth, full_scale=1.0), np.clip(truth, -1.0, 1.0))


@pytest.mark.parametrize(
    "settings", [{"white": -0.1}, {"bits": 12}, {"unit": "volt"}, {"full_scale": 0.0}, {"hum_frequency_hz": 0.0}]
)
def test_channel_noise_refuses(settings):
    with pytest.raises(InputError) as caught:
        ChannelNoise(**settings)
    assert all((caught.value.expected, caught.value.found, caught.value.where, caught.value.remedy))


def test_streams_are_spawned_and_distinct():
    """A stream is what nested ``spawn`` gives; no two are alike; the key alone decides."""
    first = {
        (record, purpose): stream(42, record, purpose).standard_normal(4).tobytes()
        for record in range(5)
        for purpose in PURPOSES
    }
    assert len(set(first.values())) == 5 * len(PURPOSES)
    spawned = np.random.SeedSequence(42).spawn(4)[3].spawn(3)[2]
    assert first[3, "reference"] == np.random.default_rng(spawned).standard_normal(4).tobytes()
    child = np.random.SeedSequence(9, spawn_key=(1,))
    again = np.random.SeedSequence(9).spawn(2)[1]
    assert stream(child, 0, "excitation noise").integers(2**62) == stream(again, 0, "excitation noise").integers(2**62)

"""Excitations against their definitions: shape, energy, band, names of frequencies."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, signal

from vibrident.base.fft_lengths import fast_length
from vibrident.physics.simulation import (
    BandLimitedRandom,
    Decay,
    HalfSineShock,
    Multisine,
    Sine,
    Superposition,
    Sweep,
    nominal_frequency_name,
    one_third_octave,
    random_phases,
)
from vibrident.physics.simulation.motion import SampleGrid, Tones, acceleration_on


def test_one_third_octave_counts_and_values_of_iso_266():
    band = one_third_octave(10.0, 1000.0)
    assert band.size == 21
    assert one_third_octave(0.1, 1000.0).size == 41
    np.testing.assert_allclose(band[[0, 10, 12, 20]], [10.0, 100.0, 158.48931924611134, 1000.0], rtol=1e-15)
    np.testing.assert_allclose(band[1:] / band[:-1], 10.0**0.1, rtol=1e-14)


def test_limits_may_be_nominal():
    assert one_third_octave(12.5, 31.5).tolist() == [10.0 ** (n / 10.0) for n in range(11, 16)]
    assert one_third_octave(160.0, 160.0).size == 1


NAMES = {-10: "0.1", -9: "0.125", -2: "0.63", 0: "1", 5: "3.15", 11: "12.5", 12: "16", 15: "31.5", 18: "63"}
NAMES |= {22: "160", 25: "315", 30: "1000", 31: "1250", 40: "10000", 43: "20000"}


@pytest.mark.parametrize(("n", "name"), NAMES.items())
def test_nominal_names(n, name):
    assert nominal_frequency_name(10.0 ** (n / 10.0)) == name


def test_other_frequencies_keep_their_value():
    assert nominal_frequency_name(160.0) == "160"
    assert nominal_frequency_name(777.77) == "777.77"


def test_sine_is_its_formula():
    t = np.linspace(-0.1, 0.3, 1001)
    expected = 9.8 * np.cos(2 * np.pi * 159.3 * t + 0.7)
    np.testing.assert_allclose(Sine(159.3, 9.8, 0.7).value(t), expected, atol=1e-11)


def test_multisine_has_exactly_its_tones():
    """A least-squares fit of the very tones leaves nothing, and gives back amplitudes and phases."""
    f, a, p = (10.0, 31.6227766, 333.3), (1.0, 0.5, 2.0), (0.1, -2.0, 3.0)
    t = np.arange(4000) / 5000.0
    y = Multisine(f, a, p).value(t)
    basis = np.exp(2j * np.pi * np.outer(t, f))
    coefficients = np.linalg.lstsq(np.hstack([basis.real, -basis.imag]), y, rcond=None)[0]
    np.testing.assert_allclose(
        coefficients[:3] + 1j * coefficients[3:], np.array(a) * np.exp(1j * np.array(p)), atol=1e-11
    )


def test_random_phases_fill_the_circle(rng):
    phases = np.array(random_phases(10000, rng))
    assert phases.min() >= 0.0
    assert phases.max() < 2 * np.pi
    assert abs(np.mean(np.exp(1j * phases))) < 0.03  # 3 standard deviations


@pytest.mark.parametrize("law", ["linear", "log"])
def test_sweep_frequency_follows_its_law(law):
    """The derivative of the cycles is the frequency: from start to stop by the law, in numbers."""
    sweep = Sweep(20.0, 500.0, 2.0, 1.0, law)
    t = np.linspace(0.01, 1.99, 199)
    step = 1e-5
    frequency = (sweep.cycles(t + step) - sweep.cycles(t - step)) / (2 * step)
    expected = 20.0 + 240.0 * t if law == "linear" else 20.0 * 25.0 ** (t / 2.0)
    np.testing.assert_allclose(frequency, expected, rtol=1e-7)


@pytest.mark.parametrize("law", ["linear", "log"])
def test_sweep_stays_inside_its_band(law):
    """Less than 1e-3 of the energy lies outside 10 % around the band, and 1e-9 above twice its end."""
    sweep = Sweep(50.0, 1000.0, 1.0, 3.0, law)
    rate, n = 20000.0, 2**16
    a = sweep.value(np.arange(n) / rate)
    energy = np.abs(np.fft.rfft(a)) ** 2
    f = np.fft.rfftfreq(n, 1 / rate)
    assert np.sum(energy[(f < 45.0) | (f > 1100.0)]) < 1e-3 * np.sum(energy)
    assert np.sum(energy[f > 2000.0]) < 1e-9 * np.sum(energy)


def test_sweep_is_zero_outside_and_bounded_inside():
    sweep = Sweep(10.0, 100.0, 1.0, 2.0, taper=0.1)
    t = np.linspace(-0.5, 1.5, 2001)
    a = sweep.value(t)
    assert np.all(a[(t < 0) | (t > 1)] == 0)
    assert 1.99 < np.max(np.abs(a)) <= 2.0


def test_random_band_rms_and_seed():
    """Exact rms over a period, power in the band alone, flat, near-Gaussian; the seed decides everything."""
    noise = BandLimitedRandom(10.0, 1000.0, 5.0, 7, 0.5)
    rate, n = 4096.0, 2048  # one period
    a = noise.value(np.arange(n) / rate)
    power = np.abs(np.fft.rfft(a) / n) ** 2 * 2
    f = np.fft.rfftfreq(n, 1 / rate)
    inside = (f >= 10.0) & (f <= 1000.0)
    assert np.sqrt(np.mean(a**2)) == pytest.approx(5.0, rel=1e-12)
    assert np.max(power[~inside]) < 1e-24 * np.max(power)
    np.testing.assert_allclose(power[inside], 25.0 / inside.sum(), rtol=1e-9)
    assert np.mean(a**4) / np.mean(a**2) ** 2 == pytest.approx(3.0, abs=0.3)
    again = BandLimitedRandom(10.0, 1000.0, 5.0, 7, 0.5).value(np.arange(n) / rate)
    other = BandLimitedRandom(10.0, 1000.0, 5.0, 8, 0.5).value(np.arange(n) / rate)
    assert again.tobytes() == a.tobytes()
    assert abs(np.corrcoef(a, other)[0, 1]) < 0.1


def test_shock_velocity_change_and_energy():
    """∫ a = 2 peak T/π and ∫ a² = peak² T/2 for a half-sine."""
    shock = HalfSineShock(500.0, 2e-3, 1e-3)
    t = np.linspace(1e-3, 3e-3, 100001)
    a = shock.value(t)
    assert integrate.simpson(a, x=t) == pytest.approx(2 * 500.0 * 2e-3 / np.pi, rel=1e-12)
    assert integrate.simpson(a**2, x=t) == pytest.approx(500.0**2 * 1e-3, rel=1e-12)
    assert np.all(shock.value(np.array([0.0, 0.999e-3, 3.001e-3])) == 0)
    assert shock.value(np.array([2e-3]))[0] == pytest.approx(500.0)


def test_decay_moves_nothing():
    assert not np.any(Decay(3.0).value(np.arange(5.0)))


def test_superposition_adds():
    parts = (Sine(10.0, 1.0), HalfSineShock(2.0, 0.1, 0.05))
    t = np.linspace(0, 0.3, 301)
    both = Superposition(parts)
    np.testing.assert_array_equal(both.value(t), parts[0].value(t) + parts[1].value(t))
    assert (both.kind, both.highest_hz, both.breaks_s) == ("sine", 10.0, pytest.approx((0.05, 0.15)))


@pytest.mark.parametrize("count", [3, 200])
@pytest.mark.parametrize("start", [0.0, -0.0123456, 0.5000001])
def test_tones_on_a_grid_are_their_values(rng, count, start):
    """The block sum and the FFT agree with the plain sum, from any fractional position, past one period."""
    rate, period = 1000.0, 900
    phasor = rng.standard_normal(count) + 1j * rng.standard_normal(count)
    tones = Tones(np.arange(1, count + 1) * rate / period, phasor, rate / period)
    grid = SampleGrid(start, rate, 2000)
    expected = (np.exp(2j * np.pi * np.outer(grid.times_s, tones.frequency_hz)) @ phasor).real
    np.testing.assert_allclose(tones.on(grid), expected, atol=2e-11 * np.sqrt(count))
    np.testing.assert_allclose(tones.at(grid.times_s), expected, atol=2e-11 * np.sqrt(count))


def test_acceleration_on_a_grid_is_the_value(rng):
    parts = (BandLimitedRandom(1.0, 300.0, 1.0, 3, 1.0), HalfSineShock(2.0, 0.1, 0.05), Sine(33.3, 2.0))
    grid = SampleGrid(0.01234, 1000.0, 500)
    np.testing.assert_allclose(
        acceleration_on(Superposition(parts), grid), Superposition(parts).value(grid.times_s), atol=1e-11
    )


@given(st.integers(1, 10**7))
def test_fast_length_is_the_smallest_smooth_number(least):
    found = fast_length(least)
    assert found >= least
    rest = found
    for prime in (2, 3, 5):
        while rest % prime == 0:
            rest //= prime
    assert rest == 1
    if least < 5000:
        smooth = {2**a * 3**b * 5**c for a in range(14) for b in range(9) for c in range(7)}
        assert found == min(value for value in smooth if value >= least)


@given(st.floats(-1.0, 1.0), st.floats(1.0, 1e6), st.integers(1, 500), st.floats(-1.0, 1.0))
def test_grid_since_starts_at_or_after(start, rate, samples, instant):
    grid = SampleGrid(start, rate, samples)
    later = grid.since(instant)
    first = grid.first_from(instant)
    assert later.samples == samples - first
    assert later.start_s >= 0.0
    if later.samples:
        assert math.isclose(later.start_s + instant, grid.times_s[first], abs_tol=2e-9 / rate + 1e-15)
    if 0 < first < samples:
        assert later.start_s < 1.0 / rate


def test_sweep_window_is_what_signal_books_call_a_taper():
    """Half of the ramp stands at half its width, and its slope vanishes at both ends."""
    sweep = Sweep(100.0, 100.0, 1.0, 1.0, taper=0.2)
    t = np.arange(20001) / 20000.0
    envelope = np.abs(signal.hilbert(sweep.value(t)))
    assert envelope[2000] == pytest.approx(0.5, abs=0.01)
    assert envelope[10000] == pytest.approx(1.0, abs=1e-3)

"""The band-limited step against the continuous response, and the Legendre inputs it is made of."""

import numpy as np
import pytest
from numpy.polynomial import legendre
from tests.support.discrete_sensors import accelerometer, recursion, system_of, weights_of, without_free_response

from vibrident.physics.discretisation import band_limited_inputs, method, sampled_inputs
from vibrident.physics.discretisation.inputs import HALF_WIDTH, band_limited_filters, filtered, kernel_for
from vibrident.physics.models import parse

N = 600


def band_limited_error(
    p, rate, frequency, name="accelerometer", quantity="acceleration", delay=0.0, moved=0.0, beside_direct=False
):
    """Largest error of the network's response to a tone where its inputs are usable, relative to the amplitude.

    ``delay`` (samples): at which the inputs are interpolated; ``moved`` is what the output weights add to it.
    ``beside_direct``: relative to the part of the input in the response, where that is larger than the response.
    """
    chosen = method("bandlimited")
    model, system = parse(name), system_of(p, name, quantity)
    wn, damping = 2 * np.pi * p["natural_frequency"], p["damping_ratio"]
    fastest = wn * (damping + np.sqrt(damping**2 - 1) if damping > 1 else 1.0)
    terms = chosen.terms(fastest / rate, direct=bool(system.d))
    times = np.arange(N) / rate
    step = chosen.inputs(np.cos(2 * np.pi * frequency * times), np.ones(N, dtype=bool), terms, delay)
    usable = np.flatnonzero(step.usable)
    assert usable.size > N - 2 * HALF_WIDTH - 3
    assert np.all(np.diff(usable) == 1)
    weights = weights_of("bandlimited", p, 1 / rate, step.fraction - moved, terms, name, quantity)
    found = recursion(weights, step.coefficients[usable], np.zeros(2))
    h = complex(model.frequency_response(p, np.array([frequency]), quantity)[0])
    exact = np.real(h * np.exp(2j * np.pi * frequency * (times[usable] - (delay + moved) / rate)))
    error = np.max(np.abs(without_free_response(weights, found - exact)))
    direct = sum(abs(float(d)) * (2 * np.pi * frequency) ** m for m, d in enumerate(system.d))
    return error / (max(abs(h), direct) if beside_direct else abs(h))


TONES = (0.001, 0.013, 0.1, 0.25, 0.33, 0.4)
#: Natural frequency over sampling rate: from far inside the band to far above half the sampling rate.
STIFFNESS = (0.003, 0.0127, 0.2, 0.6, 3.0, 30.0)


@pytest.mark.parametrize("stiffness", STIFFNESS)
@pytest.mark.parametrize("damping", [0.02, 0.182, 0.7, 2.0])
def test_the_exact_response_for_tones_up_to_the_usable_band(stiffness, damping):
    """Within 1e-6 of the continuous response up to 0.4 fs, for every sensor: what the interpolation leaves."""
    rate = 2560.0
    p = accelerometer(stiffness * rate, damping)
    assert max(band_limited_error(p, rate, tone * rate) for tone in TONES) < 1e-6


@pytest.mark.parametrize("delay", [0.0, 1.0, 7.0, -3.0, 0.25, 12.8, -0.6, -41.37])
def test_delays_whole_fractional_and_negative(delay):
    p = accelerometer(652.0, 0.182)
    assert max(band_limited_error(p, 10000.0, tone * 10000.0, delay=delay) for tone in TONES) < 1e-6


@pytest.mark.parametrize("delay", [0.0, 0.25, 0.5, 1.285, 12.8, -0.6])
@pytest.mark.parametrize(
    ("name", "slowest", "largest"), [("accelerometer", 1e-8, 1e-8), ("velocity-pickup", 1e-5, 1e-6)]
)
def test_derivatives_of_a_displacement_far_below_the_resonance(name, slowest, largest, delay):
    """A resonance far above the band enlarges what interpolation and rounding leave, by the second or third derivative.

    It was 2e-5 and 3e-4 where a step between two samples lacked its last tap, and slow tones 1e-7 and 3e-4 by rounding.
    A window that jumped at its ends left 8e-8 and 3e-5: a sweep over three octaves was no model's response.
    """
    gain = {"accelerometer": "sensitivity", "velocity-pickup": "generator_constant"}[name]
    p = {gain: 1.0, "natural_frequency": 5.3 * 512.0, "damping_ratio": 0.03}
    tones = (0.005, 0.02, 0.05, 0.1, 0.2)
    errors = [band_limited_error(p, 512.0, tone * 512.0, name, "displacement", delay=delay) for tone in tones]
    assert errors[0] < slowest
    assert max(errors[1:]) < largest


@pytest.mark.parametrize("moved", [0.3, -0.3, 0.8, -1.0])
def test_a_delay_that_moves_during_the_fit_is_in_the_output_weights(moved):
    """Inputs interpolated at one delay, read out at another, up to a sample away: the fit's way to the optimum."""
    p = accelerometer(652.0, 0.182)
    errors = [band_limited_error(p, 10000.0, tone * 10000.0, delay=2.4, moved=moved) for tone in (0.01, 0.05, 0.1)]
    assert max(errors) < 1e-4  # a polynomial read outside its step; the inputs are interpolated anew before the end
    assert errors[0] < 1e-8


@pytest.mark.parametrize("quantity", ["velocity", "displacement"])
@pytest.mark.parametrize(
    ("name", "stiffness"),
    [("accelerometer", 0.003), ("accelerometer", 0.2), ("accelerometer", 0.6), ("velocity-pickup", 0.003)],
)
def test_references_in_velocity_and_displacement(name, stiffness, quantity):
    """Within 1e-6 of the response's amplitude, for tones that a displacement can still tell from rest."""
    rate = 2000.0
    gain = {"accelerometer": "sensitivity", "velocity-pickup": "generator_constant"}[name]
    p = {gain: -28.8, "natural_frequency": stiffness * rate, "damping_ratio": 0.56}
    errors = [band_limited_error(p, rate, tone * rate, name, quantity) for tone in (0.05, 0.1, 0.25, 0.33, 0.4)]
    assert max(errors) < 1e-6, errors
    assert band_limited_error(p, rate, 0.2 * rate, name, quantity, delay=1.4) < 1e-6


@pytest.mark.parametrize("stiffness", [0.2, 0.6, 3.0])
def test_slow_motion_is_differentiated_as_well(stiffness):
    """An accelerometer feels a displacement's second derivative; that of the interpolation was 6e-4 off.

    Of a tone of 2000 samples a period it is 1e-5 of the displacement over the square of the sampling interval.
    """
    rate = 2000.0
    p = {"sensitivity": 1.0, "natural_frequency": stiffness * rate, "damping_ratio": 0.05}
    tones = (0.0005, 0.001, 0.003, 0.01, 0.03)
    errors = [band_limited_error(p, rate, tone * rate, quantity="displacement") for tone in tones]
    assert max(errors) < 1e-5, errors
    assert max(errors[2:]) < 2e-7, errors


@pytest.mark.parametrize("quantity", ["velocity", "displacement"])
@pytest.mark.parametrize("name", ["accelerometer", "velocity-pickup"])
@pytest.mark.parametrize("stiffness", STIFFNESS[2:])
def test_where_the_input_all_but_cancels_the_error_is_small_beside_the_input(name, quantity, stiffness):
    """Far below its natural frequency a sensor takes derivatives of a velocity or displacement: S0 ωn² (x − …).

    The interpolation's own 1e-8 is then relative to the parts that cancel, not to what they leave.
    """
    rate = 2000.0
    gain = {"accelerometer": "sensitivity", "velocity-pickup": "generator_constant"}[name]
    p = {gain: 1.0, "natural_frequency": stiffness * rate, "damping_ratio": 0.56}
    errors = [band_limited_error(p, rate, tone * rate, name, quantity, beside_direct=True) for tone in TONES]
    assert max(errors) < 1e-7, errors


def test_coefficients_of_a_tone_are_its_legendre_projections():
    """c_j(k) = (2j + 1) ∫₀¹ a(t_k + x Ts) P_j(2x − 1) dx, by quadrature of the continuous tone."""
    x, w = legendre.leggauss(40)
    for cycles in (0.01, 0.2, 0.4):
        k = np.arange(N)
        step = band_limited_inputs(np.cos(2 * np.pi * cycles * k + 0.3), np.ones(N, dtype=bool), 8, 0.0)
        inner = k[step.usable]
        values = np.cos(2 * np.pi * cycles * (inner[:, None] + 0.5 * (x + 1)) + 0.3)
        expected = 0.5 * (values * w) @ legendre.legvander(x, 7) * (2 * np.arange(8) + 1)
        np.testing.assert_allclose(step.coefficients[step.usable], expected, atol=3e-7)


@pytest.mark.parametrize("band", [0.0, 0.02, 0.05, 0.1, 0.2, 0.256, 0.3, 0.35, 0.4])
def test_inputs_for_a_band_are_accurate_within_it_from_few_samples(band):
    """A step loses 8/(1 − 2 f) samples at either end of a record: 8 of slow motion, 40 up to the usable band."""
    filters = band_limited_filters(np.ones(N, dtype=bool), 6, 0.0, band)
    assert filters.usable.sum() == N - 2 * np.ceil(8.0 / (1.0 - 2.0 * band) - 1e-9) + 1
    samples = np.arange(filters.filters.shape[1]) + filters.first
    x, w = legendre.leggauss(40)
    for cycles in np.linspace(0.0, band, 20):
        values = np.exp(1j * np.pi * cycles * (x + 1))
        expected = 0.5 * (values * w) @ legendre.legvander(x, 5) * (2 * np.arange(6) + 1)
        np.testing.assert_allclose(filters.filters @ np.exp(2j * np.pi * cycles * samples), expected, atol=2e-9)


def test_gain_one_at_zero_frequency_and_polynomials():
    """A constant gives c_0 = 1 and nothing else; a straight line its middle and half its rise; a parabola a c_2."""
    t = (np.arange(N) - N / 2) / N  # the signal's own unit: ±1/2 over the record
    everywhere = np.ones(N, dtype=bool)
    h = 1 / N
    middle = t + 0.5 * h
    zero = np.zeros_like(t)
    cases = {
        0: (np.ones(N), [np.ones(N), zero, zero, zero]),
        1: (t, [middle, zero + 0.5 * h, zero, zero]),
        2: (t**2, [middle**2 + h**2 / 12, middle * h, zero + h**2 / 6, zero]),
    }
    for samples, expected in cases.values():
        step = band_limited_inputs(samples, everywhere, 4, 0.0)
        found = step.coefficients[step.usable]
        np.testing.assert_allclose(found, np.stack(expected, axis=1)[step.usable], atol=2e-8)


def test_steps_that_need_an_invalid_sample_are_not_used(rng):
    """One bad sample takes out the 80 steps whose window holds it, and its value reaches no other step."""
    samples, valid = rng.standard_normal(N), np.ones(N, dtype=bool)
    valid[200] = False
    spoilt = samples.copy()
    spoilt[200] = 1e9
    good = band_limited_inputs(samples, valid, 5, 0.0)
    bad = band_limited_inputs(spoilt, valid, 5, 0.0)
    expected = np.zeros(N, dtype=bool)
    expected[HALF_WIDTH - 1 : N - HALF_WIDTH] = True
    expected[200 - HALF_WIDTH : 200 + HALF_WIDTH] = False
    np.testing.assert_array_equal(good.usable, expected)
    np.testing.assert_array_equal(bad.usable, expected)
    np.testing.assert_allclose(bad.coefficients[expected], good.coefficients[expected], atol=1e-12)
    clean = band_limited_inputs(samples, np.ones(N, dtype=bool), 5, 0.0)
    np.testing.assert_allclose(good.coefficients[expected], clean.coefficients[expected], atol=1e-12)


@pytest.mark.parametrize("terms", [1, 2])
def test_sampled_inputs_and_their_mask(terms, rng):
    samples, valid = rng.standard_normal(50), np.ones(50, dtype=bool)
    valid[20] = False
    step = sampled_inputs(samples, valid, terms, 0.0)
    used = np.flatnonzero(~step.usable).tolist()
    assert used == ([20] if terms == 1 else [19, 20, 49])
    if terms == 1:
        np.testing.assert_array_equal(step.coefficients[:, 0], samples)
    else:
        begin = step.coefficients[:-1] @ [1, -1]  # P_0 − P_1 at the step's start
        end = step.coefficients[:-1] @ [1, 1]
        np.testing.assert_allclose(begin, samples[:-1], rtol=1e-14)
        np.testing.assert_allclose(end, samples[1:], rtol=1e-14)


@pytest.mark.parametrize(("delay", "whole", "fraction"), [(2.0, 2, 0.0), (2.3, 3, 0.7), (-1.6, -1, 0.6), (0.0, 0, 0.0)])
def test_a_delay_is_whole_samples_and_a_fraction(delay, whole, fraction, rng):
    """τ = (n − f) Ts: step k − n meets response sample k, and is read at f."""
    samples = rng.standard_normal(60)
    step = sampled_inputs(samples, np.ones(60, dtype=bool), 1, delay)
    assert step.fraction == pytest.approx(fraction, abs=1e-12)
    k = np.flatnonzero(step.usable)
    np.testing.assert_array_equal(step.coefficients[k, 0], samples[k - whole])
    assert k.size == 60 - abs(whole)


def test_short_records_get_a_shorter_window():
    assert [kernel_for(n).half_width for n in (8, 20, 48, 100, 200, 10**6)] == [4, 4, 9, 20, 40, 40]
    step = band_limited_inputs(np.cos(0.05 * np.arange(30)), np.ones(30, dtype=bool), 4, 0.0)
    assert step.usable.sum() == 30 - 2 * 6 + 1


@pytest.mark.parametrize("turns", [0.003, 0.13, 0.38])
def test_a_filter_acts_on_the_signal_between_samples(turns):
    """An average over 7.3 samples, of a tone, where all samples that it needs are there."""
    window, wave, valid = 7.3, np.exp(2j * np.pi * (turns * np.arange(N) + 0.1)), np.ones(N, dtype=bool)
    valid[300] = False

    def average(f):
        return np.exp(-1j * np.pi * f * window) * np.sinc(f * window)

    found, whole = filtered(np.where(valid, wave.real, np.nan), valid, average)
    exact = (average(turns) * wave).real
    assert np.max(np.abs(found - exact)[whole]) < 1e-8 * abs(average(turns))
    assert N - np.sum(whole) < 4 * (2 * HALF_WIDTH + window)
    assert not whole[300 - HALF_WIDTH // 2 : 300 + HALF_WIDTH // 2].any()

"""The multi-channel sine fit against the truth, and its stated variance against plain Monte Carlo."""

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident import identify
from vibrident.data.records import Record
from vibrident.fit.response import MeasuredResponse, find_tones, measure_tones
from vibrident.fit.response.sine_fit import tone_frequency
from vibrident.physics.models import parse
from vibrident.physics.simulation import ChannelNoise, simulate, with_noise

RATE = 5000.0
P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
X, Y = 9.8 * np.exp(0.3j), 1.1 * np.exp(-0.9j)


def a_record(frequency, samples=2000, x=X, y=Y, more=lambda t: (0.0, 0.0), valid=None, near=None):
    t = np.arange(samples) / RATE
    turn = np.exp(2j * np.pi * frequency * t)
    extra = more(t)
    reference, response = (x * turn).real + extra[0], (y * turn).real + extra[1]
    return Record("tone", reference, response, RATE, "sine", frequency_hz=near, valid=valid)


def errors(record, frequency, **choices):
    found = measure_tones([record], **choices)
    return (
        abs(found.frequency_hz[0] / frequency - 1),
        abs(found.reference[0] / X - 1),
        abs(found.response[0] / Y - 1),
    )


@pytest.mark.parametrize("frequency", [2.6, 6.25, 10.0, 33.333, 123.4567, 999.0, 1600.1, 2240.0])
@pytest.mark.parametrize("near", [None, 1.0])
def test_clean_tones_on_and_off_the_bins(frequency, near):
    """Frequency and both amplitudes to 1e-8, from one period on; bins are 2.5 Hz apart."""
    record = a_record(frequency, near=None if near is None else frequency * 1.02)
    assert max(errors(record, frequency)) < 1e-8
    assert abs(tone_frequency(record) / frequency - 1) < 1e-8


def test_harmonics_offset_and_trend_do_no_harm():
    """Harmonics 2 to 5, an offset and a trend in each channel are fitted along: amplitudes to 1e-4 with what they pull.

    Their distortion is reported; the frequency comes from a fit without harmonics, which they pull by a little.
    """

    def more(t):
        a = 2 * np.pi * 41.7 * t
        return 3.0 + 2.0 * t, -0.5 + 0.1 * t + 0.11 * np.cos(2 * a + 1) + 0.055 * np.sin(5 * a)

    record = a_record(41.7, more=more)
    assert max(errors(record, 41.7)) < 1e-4
    assert max(errors(record, 41.7, frequencies_hz=[41.7])) < 1e-9
    found = measure_tones([record], [41.7])
    assert found.distortion[0, 0] < 1e-9
    assert found.distortion[0, 1] == pytest.approx(np.hypot(0.1, 0.05), rel=1e-6)


def test_missing_samples_do_no_harm(rng):
    valid = rng.uniform(size=2000) > 0.3
    valid[500:700] = False
    record = a_record(123.4567, valid=valid)
    spoilt = np.where(valid, record.response, 1e3)
    record = Record("gaps", record.reference, spoilt, RATE, "sine", valid=valid)
    assert max(errors(record, 123.4567)) < 1e-8


@pytest.mark.parametrize("periods", [1.0, 1.4, 2.0, 2.7])
def test_fewer_than_three_periods_have_no_trend(periods):
    """A trend would look like part of the sine; without one the amplitudes of a clean tone are right."""
    frequency = periods * RATE / 2000
    assert max(errors(a_record(frequency), frequency)) < 1e-6


def test_the_free_response_of_known_poles_is_fitted_along():
    """A decaying start transient of the sensor beside the tone, 30 % of it, leaves the amplitude alone."""
    wn = 2 * np.pi * 652.0
    pole = wn * (-0.182 + 1j * np.sqrt(1 - 0.182**2))

    def more(t):
        return 0.0, 0.3 * (np.exp(pole * t) * np.exp(1j)).real

    record = a_record(123.4567, more=more)
    poles = np.array([pole, np.conj(pole)])
    assert errors(record, 123.4567, frequencies_hz=[123.4567], poles=poles)[2] < 1e-9
    assert errors(record, 123.4567, frequencies_hz=[123.4567])[2] > 1e-4


@pytest.mark.parametrize("decay", [0.9, 2.5, 20.0])
def test_a_free_response_that_is_gone_by_the_second_sample_is_fitted_along(decay):
    """Of an overdamped sensor: the first of 2,000 samples was off by twice the tone, and the amplitude by 0.2 %."""
    record = a_record(123.4567, more=lambda t: (0.0, 2.0 * np.exp(-decay * RATE * t)))
    found = errors(record, 123.4567, frequencies_hz=[123.4567], poles=np.array([-decay * RATE, -1.0]))
    assert found[2] < 1e-9
    assert errors(record, 123.4567, frequencies_hz=[123.4567])[2] > 1e-4


def test_an_overdamped_sensor_that_has_moved_before_the_record_is_no_misfit():
    """χ²/ν was 9 and 16 in sines: its fast pole is gone by the second sample."""
    for seed in (24, 29):
        trial = BY_NAME["clean/in-over/sine/reference 1 %"].trial(seed)
        result = identify(trial.calibration(), model=trial.model)
        assert result.fit.chi2_reduced < 2.0
        assert set(result.warning_codes) <= {"polarity"}


def test_the_quick_look_finds_the_same_tone(rng):
    """``find_tones`` on a noisy tone: within four of its own standard deviations of the truth."""
    noise = rng.standard_normal((2, 2000)) * [[0.3], [0.05]]
    record = a_record(123.4567, more=lambda t: noise)
    found = find_tones([record])
    for amplitude, true, sigma in ((found.reference[0], X, 0.3), (found.response[0], Y, 0.05)):
        assert abs(amplitude - true) < 4 * np.sqrt(2) * sigma * np.sqrt(2 / 2000)
    stated = np.sqrt(np.mean(np.abs(found.line_response) ** 2)), np.sqrt(np.mean(np.abs(found.line_reference) ** 2))
    assert stated == pytest.approx((0.05 * np.sqrt(2 / 2000), 0.3 * np.sqrt(2 / 2000)), rel=0.1)


def response_of(f):
    return parse("accelerometer").frequency_response(P, np.asarray(f))


def monte_carlo(frequency, samples, draw, rng, draws):
    """Y − H X of many noisy records: its values, and the variance of its real part as each record states it."""
    h = response_of([frequency])[0]
    values, stated = [], []
    for _ in range(draws):
        noise = draw(rng, samples)
        record = a_record(frequency, samples, y=h * X, more=lambda t, noise=noise: noise)
        found = measure_tones([record], [frequency])
        values.append(found.response[0] - h * found.reference[0])
        stated.append(found.error_deviation(response_of)[0] ** 2)
    return np.array(values), np.array(stated)


def white_response(rng, n):
    return np.zeros(n), 0.05 * rng.standard_normal(n)


def white_both(rng, n):
    return 0.3 * rng.standard_normal(n), 0.02 * rng.standard_normal(n)


def falling(rng, n, exponent=2.0):
    """Noise power ∝ 1/f^exponent on the response."""
    order = np.maximum(np.arange(4 * n + 1), 1.0)
    spectrum = (rng.standard_normal(4 * n + 1) + 1j * rng.standard_normal(4 * n + 1)) * order ** (-0.5 * exponent)
    spectrum[0] = 0.0
    return np.zeros(n), 300.0 * np.fft.irfft(spectrum, 8 * n)[:n]


@pytest.mark.parametrize(
    ("draw", "frequency", "samples"),
    [
        (white_response, 123.4567, 2000),
        (white_response, 25.0, 400),
        (white_response, 1900.0, 1000),
        (white_both, 123.4567, 2000),
        (white_both, 25.0, 2000),
        (white_both, 1900.0, 1000),
        (white_both, 25.0, 400),
    ],
)
@pytest.mark.draws(100, 300)
def test_the_stated_variance_is_that_of_the_estimate(draw, frequency, samples, rng, draws):
    """Mean stated variance over the scatter of the real and imaginary parts: one within three standard errors.

    A variance from N draws of two parts has the relative standard error 1/√N; the stated ones' mean adds its own.
    """
    values, stated = monte_carlo(frequency, samples, draw, rng, draws)
    scatter = np.mean(np.abs(values) ** 2) / 2
    own = np.std(stated) / np.mean(stated) / np.sqrt(draws)
    assert np.mean(stated) / scatter == pytest.approx(1.0, abs=3 * np.hypot(1 / np.sqrt(draws), own))
    assert abs(np.mean(values)) < 3 * np.sqrt(2 * scatter / draws)  # no bias


@pytest.mark.draws(100, 300)
def test_noise_that_falls_with_frequency_is_weighed_where_the_tone_is(rng, draws):
    """The mean of the lines around the tone would be wrong by 20 % and more; the power law through them is not."""
    values, stated = monte_carlo(25.0, 2000, falling, rng, draws)
    scatter = np.mean(np.abs(values) ** 2) / 2
    own = np.std(stated) / np.mean(stated) / np.sqrt(draws)
    assert np.mean(stated) / scatter == pytest.approx(1.0, abs=3 * np.hypot(1 / np.sqrt(draws), own))


@pytest.mark.parametrize("exponent", [1.0, 2.0])
@pytest.mark.parametrize("periods", [2.3, 3.2, 5.3, 8.7])
@pytest.mark.draws(60, 300)
def test_a_slow_tone_is_as_uncertain_as_slow_noise_makes_it(exponent, periods, rng, draws):
    """Of few periods, the square over the stated variance was 3 to 21 on average: harmonics hid the lines near by."""
    samples = 1000
    values, stated = monte_carlo(
        periods * RATE / samples, samples, lambda rng, n: falling(rng, n, exponent), rng, draws
    )
    squares = np.abs(values) ** 2 / 2 / stated
    assert 0.5 < np.mean(squares) < 2.5  # a variance of few lines scatters, and its inverse has a larger mean


@pytest.mark.parametrize("periods", [12.4, 49.7])
@pytest.mark.draws(150, 400)
def test_as_much_leaks_into_a_tone_as_into_the_lines_beside_it(periods, rng, draws):
    """The ends of a random walk differ: under a window its variance was stated a third too small."""
    samples = 1000
    values, stated = monte_carlo(periods * RATE / samples, samples, falling, rng, draws)
    scatter = np.mean(np.abs(values) ** 2) / 2
    assert scatter / np.mean(stated) < 1.0 + 3.0 / np.sqrt(draws)


@pytest.mark.draws(100, 300)
def test_degrees_of_freedom_of_the_variance(rng, draws):
    """var(s²)/E(s²)² = 2/ν for white noise, within three standard errors (relative √(2/N), and kurtosis)."""
    _, stated = monte_carlo(400.0, 2000, white_response, rng, draws)
    found = measure_tones([a_record(400.0, 2000)], [400.0])
    expected = 2 / found.degrees_of_freedom[0]
    observed = np.var(stated) / np.mean(stated) ** 2
    assert observed / expected == pytest.approx(1.0, abs=3 * np.sqrt(2 / draws) * 1.5)


def test_excitation_noise_cancels_and_reference_noise_does_not():
    """Noise that the sensor feels at 20 dB leaves a deviation below a tenth of its own size; the same noise on the
    reference alone counts in full, |H| σ √(2/N).
    """
    frequency, n = 300.0, 8000
    base = {"frequencies_hz": [frequency], "samples": n, "sampling_rate_hz": 10e3, "start": "steady"}
    h = abs(response_of([frequency])[0])
    felt = simulate(("accelerometer", P), excitation_snr_db=20.0, seed=4, **base).records
    quiet = simulate(("accelerometer", P), seed=4, **base)
    sigma = 9.80665 / np.sqrt(2) / 10
    noisy = with_noise(quiet, reference_noise=ChannelNoise(white=0.1), seed=4).records
    full = h * sigma * np.sqrt(2 / n)
    deviation = {
        name: measure_tones(records, [frequency]).error_deviation(response_of)[0]
        for name, records in (("felt", felt), ("reference", noisy), ("quiet", quiet.records))
    }
    assert deviation["reference"] / full == pytest.approx(1.0, abs=0.2)
    assert deviation["felt"] < 0.1 * full
    assert deviation["quiet"] < 1e-4 * full


def test_a_noise_free_tone_keeps_a_floor():
    """Nothing is known better than 1e-7 of the response: rounding and interpolation lie there."""
    found = measure_tones([a_record(123.4567)])
    assert found.error_deviation(lambda f: np.full(f.shape, Y / X))[0] == pytest.approx(1e-7 * abs(Y), rel=1e-6)


def test_joined_measurements_keep_their_points(rng):
    one, two = (
        measure_tones([a_record(f, n, more=lambda t: 0.01 * rng.standard_normal((2, t.size)))], [f])
        for f, n in ((100.0, 1000), (700.0, 3000))
    )
    both = MeasuredResponse.join([one, two])
    assert both.points == 2
    np.testing.assert_allclose(both.ratio, [one.ratio[0], two.ratio[0]])
    separate = [m.error_deviation(response_of)[0] for m in (one, two)]
    np.testing.assert_allclose(both.error_deviation(response_of), separate, rtol=1e-12)


@pytest.mark.parametrize(("samples", "periods"), [(60, 0.8), (60, 1.7), (200, 2.5), (20, 3.2)])
def test_few_periods_are_as_uncertain_as_they_scatter(samples, periods):
    """Offset, harmonics and a free response take the noise beside the tone, and make the tone itself less certain."""
    rate, rng = 1000.0, np.random.default_rng(5)
    t = np.arange(samples) / rate
    omega, pole = 2.0 * np.pi * periods * rate / samples, -60.0 + 700.0j
    tone = np.cos(omega * t)
    scatter = []
    for _ in range(200):
        free = np.real(0.3 * np.exp(2j * np.pi * rng.random()) * np.exp(pole * t))
        response = 2.0 * tone + free + 0.01 * rng.standard_normal(samples)
        record = Record(
            name="short", reference=tone, response=response, sampling_rate_hz=rate, excitation="sine",
            frequency_hz=omega / (2.0 * np.pi),
        )  # fmt: skip
        found = measure_tones([record], [omega / (2.0 * np.pi)], np.array([pole, np.conj(pole)]))
        scatter.append(abs(found.ratio[0] - 2.0) ** 2 / 2.0 / found.error_deviation()[0] ** 2)
    assert 0.3 < np.median(scatter) / np.log(2.0) < 1.5  # as at the worst phase


@pytest.mark.parametrize("moving", [0.0, 3e-4])
def test_noise_of_the_response_is_known_beside_a_noisy_displacement(rng, moving):
    """Three periods: noise of the displacement, times the square of the frequency, hides the response's at most lines.

    Each channel's own lines give it, unless motion beside the tone is in both.
    """
    rate, samples, frequency = 20_000.0, 2000, 30.0
    time = np.arange(samples) / rate
    lines = np.fft.rfftfreq(samples, 1.0 / rate)

    def through(f):
        return parse("accelerometer").frequency_response(P, np.asarray(f), "displacement")

    stated, errors = [], []
    for _ in range(40):
        vibration = moving * rng.standard_normal(samples)  # in the circular sense, so that it passes H exactly
        moved = np.fft.irfft(np.fft.rfft(vibration) * np.where(lines < 1000.0, 1.0, 0.0), samples)
        answer = np.fft.irfft(np.fft.rfft(moved) * through(np.maximum(lines, 1e-3)), samples)
        turn = np.exp(2j * np.pi * frequency * time)
        reference = np.real(turn) + moved + 1e-5 * rng.standard_normal(samples)
        response = np.real(through([frequency])[0] * turn) + answer + 3.0 * rng.standard_normal(samples)
        found = measure_tones([Record("tone", reference, response, rate, "sine")], [frequency])
        stated.append(found.error_deviation(through)[0] ** 2)
        errors.append(abs(found.response[0] - through([frequency])[0] * found.reference[0]) ** 2 / 2.0)
    assert np.median(stated) == pytest.approx(np.mean(errors), rel=0.5)  # 40 draws know it to 16 %
    if not moving:
        assert np.std(stated) < 0.4 * np.mean(stated)  # once 1.5

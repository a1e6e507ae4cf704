"""Hum is found in a residual by its frequency and is an unknown of every fit; a misfit, or a harmonic, is no hum."""

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.fit.judge.hum import with_hum
from vibrident.physics.simulation import simulate

RATE, N = 2000.0, 1000
P = {"sensitivity": 0.1, "natural_frequency": 120.0, "damping_ratio": 0.6}
TONES = np.geomspace(10.3, 395.0, 15)


def beside_hum(clean, seed, hum, mains_hz=24.7):
    """Records with hum and its third harmonic, of this size against the response's rms."""
    rng, records = np.random.default_rng(seed), []
    for record in clean.records:
        t = record.time_s
        size, phase = hum * np.sqrt(2.0) * np.std(record.response), 2.0 * np.pi * rng.random(2)
        wave = np.cos(2 * np.pi * mains_hz * t + phase[0]) + 0.3 * np.cos(2 * np.pi * 3 * mains_hz * t + phase[1])
        records.append(record.with_response(record.response + size * wave, ""))
    return vibrident.Calibration(records=tuple(records), model=clean.model)


def recorded(seed, values=P, motion="multisine", repeats=4, response_noise=1e-3, **more):
    """Steady motion with a little noise."""
    frequencies = TONES if motion == "multisine" else [TONES[0], TONES[-1]]
    return simulate(
        ("accelerometer", values), motion, frequencies_hz=frequencies, sampling_rate_hz=RATE, samples=N,
        repeats=repeats, response_noise=response_noise, start="steady", seed=seed, **more,
    )  # fmt: skip


def sines(seed, frequencies_hz, values=P, response_noise=1e-3):
    made = simulate(
        ("accelerometer", values), "sine", frequencies_hz=frequencies_hz, sampling_rate_hz=RATE, samples=N,
        response_noise=response_noise, start="steady", seed=seed,
    )  # fmt: skip
    return replace(made, model="accelerometer")


def within(result, values, limit=4.0):
    for name, true in values.items():
        found = result.parameters[name]
        assert abs(found.value - true) < limit * found.standard_uncertainty, name


@pytest.mark.draws(1, 3)
def test_a_clean_sensor_beside_hum_is_adequate(draws):
    for seed in range(draws):
        result = vibrident.identify(beside_hum(recorded(seed), seed, 0.01), "accelerometer")
        assert result.warning_codes == (), seed
        within(result, P)


@pytest.mark.parametrize("motion", ["multisine", "random"])
def test_a_resonance_above_half_the_sampling_rate_is_not_drawn_to_hum(motion):
    """Its free response rings at any frequency: without damping it took the hum, 1e4 u away."""
    stiff = P | {"natural_frequency": 3127.0, "damping_ratio": 0.014}
    clean = recorded(2, stiff, motion)
    small, large = (vibrident.identify(beside_hum(clean, 5, hum), "accelerometer") for hum in (0.0, 0.05))
    within(large, stiff)
    for name in stiff:
        u = [r.parameters[name].standard_uncertainty for r in (small, large)]
        assert abs(small.parameters[name].value - large.parameters[name].value) < 2.0 * u[0], name
        assert u[1] < 1.5 * u[0], name


@pytest.mark.draws(1, 3)
def test_hum_in_a_resonance_costs_information_and_no_truth(draws):
    """24.7 Hz lies within the resonance: what free motion, response and hum have in common tells nothing."""
    sharp = P | {"natural_frequency": 24.4, "damping_ratio": 0.02}
    for seed in range(draws):
        within(vibrident.identify(beside_hum(recorded(seed, sharp, "random"), seed, 0.01), "accelerometer"), sharp)


@pytest.mark.draws(1, 3)
def test_hum_of_other_records_is_known_in_the_one_whose_tone_it_disturbs(draws):
    frequencies = np.array([13.1, 24.9, 41.3, 75.0, 120.0, 210.0, 333.0])
    for seed in range(draws):
        result = vibrident.identify(beside_hum(sines(seed, frequencies), seed, 0.01), "accelerometer")
        assert result.warning_codes == (), seed
        within(result, P)


def transfer(hz, values=P):
    """Response of a sensor to its reference."""
    over = hz / values["natural_frequency"]
    return values["sensitivity"] / (1.0 - over**2 + 2j * values["damping_ratio"] * over)


def hum_of(records, predicted):
    return [record.hum_hz for record in with_hum(tuple(records), predicted, transfer)]


def test_hum_is_seen_and_a_misfit_or_a_harmonic_is_not():
    clean = recorded(1)
    predicted = [r.response for r in recorded(1, response_noise=0.0).records]
    humming = beside_hum(clean, 1, 0.01)
    for tones in hum_of(humming.records, predicted):
        np.testing.assert_allclose(tones, (24.7, 74.1), atol=0.1)
    with_both = with_hum(humming.records, predicted, transfer)
    assert with_hum(with_both, predicted, transfer) == with_both
    assert not any(hum_of(clean.records, [1.02 * v for v in predicted]))
    bent = sines(1, [40.3, 90.7])
    steady = [r.response for r in sines(1, [40.3, 90.7], response_noise=0.0).records]
    squared = [
        r.with_response(r.response + 0.1 * v**2 / np.std(v), "") for r, v in zip(bent.records, steady, strict=True)
    ]
    assert not any(hum_of(squared, steady))


def test_hum_is_seen_where_a_late_response_leaves_the_first_part_without_a_prediction():
    clean = recorded(1)
    predicted = [r.response for r in recorded(1, response_noise=0.0).records]
    late = [np.where(np.arange(N) < 400, np.nan, v) for v in predicted]
    for tones in hum_of(beside_hum(clean, 1, 0.01).records, late):
        np.testing.assert_allclose(tones, (24.7, 74.1), atol=0.1)


def test_noise_of_the_reference_in_a_resonance_is_no_hum():
    """The noise of 1 % passes a resonance of two bins, in which each record showed a tone."""
    sharp = P | {"natural_frequency": 57.9, "damping_ratio": 0.02}
    frequencies = np.geomspace(13.1, 333.0, 7)
    quiet = sines(3, frequencies, sharp, response_noise=0.0)
    noisy = sines(3, frequencies, sharp)
    noise = np.random.default_rng(3)
    records = []
    for record in noisy.records:
        spectrum = np.fft.rfft(0.01 * np.std(record.reference) * noise.standard_normal(record.samples))
        spectrum *= transfer(np.fft.rfftfreq(record.samples, 1.0 / RATE), sharp)
        records.append(record.with_response(record.response + np.fft.irfft(spectrum, record.samples), ""))
    predicted = [record.response for record in quiet.records]
    known = with_hum(tuple(records), predicted, lambda hz: transfer(hz, sharp))
    assert not any(record.hum_hz for record in known)

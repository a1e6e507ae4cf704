"""The ellipse of two signals: unbiased by noise, its covariance true, honest where an arc tells little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vibrident.data.interferometer import ellipse, moments
from vibrident.data.interferometer.choice import choose
from vibrident.data.interferometer.demodulation import demodulate
from vibrident.data.interferometer.setting import Interferometer, signals_in_memory
from vibrident.data.interferometer.survey import survey

CENTRE, FIRST, SECOND, ANGLE = np.array([0.3, -0.2]), 1.0, 0.8, 0.15
TRUE = ellipse.Ellipse(
    CENTRE,
    np.array([[FIRST, 0.0], [SECOND * np.sin(ANGLE), SECOND * np.cos(ANGLE)]]),
    np.eye(5),
    np.ones(2),
)


def drawn(random, phase, noise):
    exact = CENTRE[:, None] + TRUE.matrix @ np.stack([np.cos(phase), np.sin(phase)])
    return exact + noise * random.standard_normal(exact.shape)


def fitted(u):
    start = ellipse.fit_circle(u)
    return ellipse.fit_ellipse([moments.sums(*part) for part in np.array_split(u, 40, axis=1)], start)


@pytest.mark.draws(60, 150)
@pytest.mark.parametrize("arc", [2.0 * np.pi, 4.0])
def test_ellipse_is_unbiased_at_five_per_cent_noise_and_its_covariance_is_true(arc, draws):
    random = np.random.default_rng(3)
    off, scaled = [], []
    for _ in range(draws):
        phase = random.uniform(-0.5 * arc, 0.5 * arc, 10_000) + random.uniform(0.0, 2.0 * np.pi)
        found = fitted(drawn(random, phase, 0.05))
        assert found is not None
        off.append(found.difference(TRUE))
        scaled.append(off[-1] / np.sqrt(np.diag(found.covariance)))
    off, scaled = np.array(off), np.array(scaled)
    scatter = off.std(axis=0) / np.sqrt(len(off))
    assert np.all(np.abs(off.mean(axis=0)) < 4.0 * scatter)
    assert np.all(np.abs(scaled.std(axis=0) - 1.0) < 3.0 / np.sqrt(2 * draws))


def test_short_arc_gives_a_circle_whose_covariance_covers_the_ellipse():
    random = np.random.default_rng(4)
    scaled = []
    for _ in range(60):
        phase = random.uniform(-0.5, 0.5, 10_000) + random.uniform(0.0, 2.0 * np.pi)
        u = drawn(random, phase, 0.01)
        assert fitted(u) is None
        found = ellipse.fit_short_arc(u, u.shape[1])
        scaled.append(found.difference(TRUE) / np.sqrt(np.diag(found.covariance)))
    # Of the amplitudes' ratio 0.8 is a prior deviation of 0.9, so none may stand far out.
    assert np.sqrt(np.mean(np.square(scaled))) < 1.5
    assert np.sqrt(np.diag(found.covariance)[0]) > 0.05


def test_sums_without_noise_are_those_of_the_exact_samples():
    random = np.random.default_rng(5)
    phase = random.uniform(0.0, 2.0 * np.pi, 400_000)
    exact = np.stack([np.cos(phase), 0.5 + np.sin(phase)])
    noise = np.array([0.04, 0.02])
    noisy = exact + np.sqrt(noise)[:, None] * random.standard_normal(exact.shape)
    clean = moments.without_noise(moments.sums(*noisy), noise)
    clean[np.add.outer(range(5), range(5)) > 4] = 0.0
    assert np.max(np.abs(clean - moments.sums(*exact))) / phase.size < 6e-3
    assert np.max(np.abs(moments.sums(*noisy) - moments.sums(*exact))) / phase.size > 0.1


def test_mean_phase_is_right_where_noise_differs_round_the_circle():
    """Noise of an ellipse is not the same all round, and moves the mean of its angle, by up to 2e-3 rad."""
    random = np.random.default_rng(6)
    known = ellipse.Ellipse(TRUE.centre, TRUE.matrix, TRUE.covariance, np.full(2, 0.08**2))
    off = []
    for angle in (0.2, 0.6, 1.1, 1.6, 2.2, 2.7):
        u = drawn(random, np.full(400_000, angle), 0.08)
        off.append([np.arctan2(*e.to_unit_circle(u)[::-1]).mean() - angle for e in (known, known.for_phase)])
    plain, better = np.ptp(np.array(off), axis=0)
    assert better < 8e-4 < 2e-3 < plain  # one mean is known to 1.6e-4


@pytest.mark.draws(12, 24)
def test_a_sine_is_off_by_the_tangential_noise_alone(draws):
    """Ellipse, correction of its mean angle, unwrapping and decimation add no bias to what the noise itself does: the
    difference, which has far less scatter than the noise, is zero within its own scatter."""
    setting, rate, hertz, swing = Interferometer("quadrature", 632.991e-9, direction=1), 4e5, 1000.0, 5.0
    random, time = np.random.default_rng(12), np.arange(40_000) / 4e5
    turn = np.exp(-2j * np.pi * hertz * time)
    added, own = [], []
    for _ in range(draws):
        phase = swing * np.cos(2.0 * np.pi * hertz * time + random.uniform(0.0, 6.0)) + random.uniform(0.0, 6.0)
        clean = CENTRE[:, None] + TRUE.matrix @ np.stack([np.cos(phase), np.sin(phase)])
        noise = 0.05 * random.standard_normal(clean.shape)
        signals = signals_in_memory(clean + noise, rate)
        seen = survey(signals)
        made = demodulate(signals, setting, seen, choose([seen], ["a"])[0], 1, "a", hertz, hertz)
        c, s = TRUE.inverse @ noise
        exact = np.mean((phase - phase.mean()) * turn)
        own.append(np.mean((np.cos(phase) * s - np.sin(phase) * c) * turn) / exact)
        added.append(np.mean(made.displacement_m / setting.metres_per_radian * turn) / exact - 1.0 - own[-1])
    scatter = np.std(own) / np.sqrt(2.0)
    for part in (np.real(added), np.imag(added)):
        assert abs(part.mean()) < 4.0 * part.std() / np.sqrt(len(part)) + 0.01 * scatter
        assert part.std() < 1.0 * scatter


def test_effect_of_an_ellipse_s_error_on_a_sine_is_as_stated():
    """By the middle of the phase as well: it was taken for zero, so that effects of one ellipse on several records were
    of the wrong sign to each other."""
    setting, rate, hertz = Interferometer("quadrature", 632.991e-9, direction=1), 4e5, 1000.0
    time = np.arange(20_000) / rate
    for swing, middle in ((5.0, 0.9), (2.0, -2.2)):
        phase = swing * np.cos(2.0 * np.pi * hertz * time) + middle
        random = np.random.default_rng(3)
        u = CENTRE[:, None] + TRUE.matrix @ np.stack([np.cos(phase), np.sin(phase)])
        signals = signals_in_memory(u + 1e-4 * random.standard_normal(u.shape), rate)
        seen = survey(signals)
        choice = choose([seen], ["a"])[0]
        exact = demodulate(signals, setting, seen, choice, 1, "a", hertz, hertz)
        for error in 1e-3 * np.eye(4):
            off = replace(choice, ellipse=choice.ellipse.reshaped(error))
            changed = demodulate(signals, setting, seen, off, 1, "a", hertz, hertz)
            change = np.std(changed.displacement_m) / np.std(exact.displacement_m) - 1.0
            assert abs(change + np.real(error @ exact.answer.relative)[0]) < 2e-5

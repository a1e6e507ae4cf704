"""Lengths that transform fast, medians and means of neighbours, each against its definition."""

import numpy as np
import pytest

from vibrident.base.fft_lengths import FACTORS, MAX_LOST_SHARE, fast_below
from vibrident.fit.bins.segments import MIN_LINE_DISTANCE, tone_bins
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.noise.projection import without_common
from vibrident.fit.response.rounding import converter_step
from vibrident.fit.response.transform import in_blocks, median, power_of, waves


@pytest.mark.parametrize("most", [8193, 15_921, 15_991, 70_001, 1_599_921])
def test_a_length_close_by_transforms_fast(most):
    found = fast_below(most)
    assert most * (1.0 - MAX_LOST_SHARE) < found <= most
    rest = found
    for prime in FACTORS:
        while rest % prime == 0:
            rest //= prime
    assert rest == 1


def test_a_short_length_stays():
    assert fast_below(997) == 997


@pytest.mark.parametrize("count", [1, 2, 7, 8])
def test_medians_are_numpys(count, rng):
    rows = rng.standard_normal((5, count))
    np.testing.assert_array_equal(median(rows), np.median(rows, axis=1))
    assert median(rows[0]) == np.median(rows[0])


def test_powers_and_blocks(rng):
    lines = rng.standard_normal(20_000) + 1j * rng.standard_normal(20_000)
    np.testing.assert_allclose(power_of(lines), np.abs(lines) ** 2, rtol=1e-14)
    assert sum(part.stop - part.start for part in in_blocks(lines.size)) == lines.size


def test_numbers_that_imitate_each_other_are_left_to_one(rng):
    """Rows, one of them twice: what is taken out by the inverse is the projection on their span."""
    rows = rng.standard_normal((3, 40)) * np.array([[1.0], [1e6], [1e-6]])
    twice, signal = np.concatenate([rows, rows[:1]]), rng.standard_normal(40)
    left = signal - (inverse_where_shown(twice @ twice.T) @ (twice @ signal)) @ twice
    np.testing.assert_allclose(left, signal - rows.T @ np.linalg.lstsq(rows.T, signal, rcond=None)[0], atol=1e-9)


def test_a_grid_is_seen_by_all_values(rng):
    """One value beside the grid in many on it: few values do not tell, all do."""
    values = np.rint(1e3 * rng.standard_normal(5000)) / 8.0
    assert converter_step(values) == 0.125
    values[1234] += 0.05
    assert converter_step(values) != 0.125


@pytest.mark.parametrize("samples", [256, 7999, 8000])
@pytest.mark.parametrize("place", [0.5, 7.01, 82.56, 100.0 + MIN_LINE_DISTANCE])
def test_bins_of_a_tone_span_the_transforms_of_its_waves(place, samples):
    made, told = tone_bins([place], samples).view(float).T, np.fft.rfft(waves([place], samples), axis=1).view(float).T
    made, told = (columns / np.linalg.norm(columns, axis=0) for columns in (made, told))
    left = told - made @ np.linalg.lstsq(made, told, rcond=1e-14)[0]
    assert np.max(np.linalg.norm(left, axis=0)) < 1e-9


def test_bins_of_a_tone_are_made_in_parts():
    part = slice(40, 90)
    np.testing.assert_array_equal(tone_bins([13.3, 61.0], 1000, part), tone_bins([13.3, 61.0], 1000)[:, part])


def test_what_is_smoothly_coherent_is_no_noise_and_noise_stays(rng):
    moved, noise = (rng.standard_normal(9602).view(complex) for _ in range(2))
    frequency = np.linspace(0.0, 1.0, noise.size)
    misfit = moved * (3.0 - 2j * frequency + frequency**2)
    (left, freedom), (alone, _) = (
        without_common(rows[None], [moved[None]], np.ones((1, noise.size))) for rows in (noise + misfit, noise)
    )
    np.testing.assert_allclose(left[:, 1:], alone[:, 1:], atol=1e-4)
    assert np.sum(power_of(left)) / np.sum(freedom) == pytest.approx(np.mean(power_of(noise)), rel=0.05)


def test_a_misfit_that_rings_on_is_no_noise(rng):
    """Fitted one after the other, motion and free motion leave a part of each, which was taken for noise."""
    moved, noise = (rng.standard_normal(2402).view(complex) for _ in range(2))
    pole = 1.0 / (np.arange(noise.size) - 300.4 - 0.2j)
    free_motion = np.stack([pole, 1j * pole])[None]
    misfit = 0.3 * moved + (20.0 - 10.0j) * pole
    (left, _), (alone, freedom) = (
        without_common(rows[None], [moved[None]], np.ones((1, noise.size)), free_motion=free_motion)
        for rows in (noise + misfit, noise)
    )
    np.testing.assert_allclose(left[:, 1:], alone[:, 1:], atol=1e-4)
    assert np.sum(power_of(left)) / np.sum(freedom) == pytest.approx(np.mean(power_of(noise)), rel=0.05)


@pytest.mark.parametrize("bins", [2, 3, 5, 6, 24])
def test_few_bins_are_nearly_all_explained(bins, rng):
    """Pieces between gaps may have so few; no more freedom is left than there are bins."""
    rows, motion = rng.standard_normal((2, bins)) + 1j * rng.standard_normal((2, bins))
    left, freedom = without_common(rows[None], [motion[None]], np.ones((1, bins)))
    assert np.all(np.isfinite(left))
    assert np.sum(freedom[0, 1:]) <= max(bins - 4, 0) + 1e-6

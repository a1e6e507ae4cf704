"""Band-limited values at other instants: exact against tones, to the pass band that is stated."""

import numpy as np
import pytest

from vibrident.data.resampling import DOUBTFUL_SAMPLES, PASS_BAND, evenly_resampled, margin_samples, resampled

SAMPLES = 3000


def tones(rng, highest):
    """A signal as a function of time in samples: 50 tones below ``highest`` of the rate."""
    frequency = rng.uniform(0.0, highest, 50)
    phase = rng.uniform(0.0, 2 * np.pi, 50)
    size = rng.normal(size=50)
    return lambda time: np.cos(2 * np.pi * np.outer(time, frequency) + phase) @ size


@pytest.mark.parametrize("jitter", [0.01, 0.2, 0.45])
def test_uneven_samples_are_evened(rng, jitter):
    """Uniform jitter of up to half an interval; 1e-6 is the kernel's pass band."""
    signal = tones(rng, 0.98 * PASS_BAND)
    places = np.arange(SAMPLES)
    stamps = places + rng.uniform(-jitter, jitter, SAMPLES)
    even = evenly_resampled(signal(stamps), stamps)
    inner = slice(DOUBTFUL_SAMPLES, -DOUBTFUL_SAMPLES)
    truth = signal(places.astype(float))
    assert np.max(np.abs(even - truth)[inner]) < 5e-6 * np.std(truth)


def test_blocks_leave_no_seam(rng):
    """Longer than a block and its overlap."""
    signal = tones(rng, 0.3)
    places = np.arange(40_000)
    stamps = places + rng.uniform(-0.3, 0.3, places.size)
    error = np.abs(evenly_resampled(signal(stamps), stamps) - signal(places.astype(float)))
    assert np.max(error[DOUBTFUL_SAMPLES:-DOUBTFUL_SAMPLES]) < 2e-5


@pytest.mark.parametrize("spacing", [1.0, 1.7, 5.0])
def test_resampling_keeps_what_the_slower_rate_holds(rng, spacing):
    signal = tones(rng, 0.98 * PASS_BAND / spacing)
    values = signal(np.arange(SAMPLES, dtype=float))
    margin = margin_samples(spacing)
    positions = np.arange(margin + 0.37, SAMPLES - 1 - margin, spacing)
    error = resampled(values, positions, spacing) - signal(positions)
    assert np.max(np.abs(error)) < 5e-6 * np.std(values)


def test_what_the_slower_rate_cannot_hold_is_taken_out(rng):
    values = np.cos(2 * np.pi * 0.4 * np.arange(SAMPLES))  # 0.8 of the new rate
    positions = np.arange(float(margin_samples(2.0)), SAMPLES - 1 - margin_samples(2.0), 2.0)
    assert np.max(np.abs(resampled(values, positions, 2.0))) < 1e-6

"""What noise leaks into quiet bins is alike in many, and tells little."""

import numpy as np

from vibrident.fit.noise.leakage import beside_leakage

BINS = 2000


def test_noise_of_one_level_leaks_nothing():
    np.testing.assert_allclose(beside_leakage(np.full(BINS, 3.0)), 3.0, rtol=1e-9)


def test_noise_above_what_leaks_stays():
    """A step of a factor of ten: leakage reaches a few bins."""
    psd = np.where(np.arange(BINS) < BINS // 2, 0.1, 1.0)
    assert np.all(beside_leakage(psd)[: BINS // 2 - 200] < 1.1 * psd[: BINS // 2 - 200])


def test_a_slow_curve_is_no_evidence_in_what_leaks(rng):
    """Of noise without low frequencies, cut out: a quiet band is next to one curve.

    By its level alone a curve of 1/(k₀ − k) there would be told from noise in most records.
    """
    samples, first, quiet = 2 * BINS, 400, slice(20, 300)
    curve = 1.0 / (first - np.arange(BINS))[quiet]
    levels, bins = np.zeros(BINS), []
    for _ in range(200):
        long = np.fft.rfft(rng.standard_normal(8 * samples))
        long[: 8 * first] = 0.0
        cut = np.fft.irfft(long)[:samples]
        bins.append(np.fft.rfft(cut)[:BINS] / np.sqrt(samples))
        levels += np.abs(bins[-1]) ** 2 / 200

    def mean_square_of_amount(psd):
        """Return the mean square of the curve's amount over its variance in that noise."""
        weight = curve / psd[quiet]
        information = 2.0 * float(weight @ curve)
        return np.mean([2.0 * (weight @ each[quiet].real) ** 2 / (0.5 * information) for each in bins])

    assert mean_square_of_amount(levels) > 20.0
    assert mean_square_of_amount(beside_leakage(levels)) < 4.0

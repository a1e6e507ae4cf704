"""Noise of the reference in the search for start values: what passes more of it is no better."""

from __future__ import annotations

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident.fit.descent.train import _observations
from vibrident.fit.problem import Evidence
from vibrident.fit.start.at_bins import candidates
from vibrident.fit.start.coarse import coarse_rows
from vibrident.physics.discretisation import method
from vibrident.physics.models import model_of

#: A mode ten times as loud in the band as the first, a delay, and noise of the reference.
BURST = "quantities/velocity/accelerometer+mode2=-0.1+delay/burst"


@pytest.fixture(scope="module")
def observations():
    trial = BY_NAME[BURST].trial(136)
    calibration = trial.calibration()
    evidence = Evidence.gather(calibration, model_of(calibration, trial.model))
    return list(_observations(evidence, method("bandlimited")))


@pytest.mark.slow
def test_the_best_place_is_the_sensor_and_not_one_that_drowns_the_records(observations):
    """Places that passed so much noise that no bin weighed anything had a seventh of its cost."""
    truth = BY_NAME[BURST].trial(136).truth
    modes = sorted([truth["natural_frequency"], truth["mode2_frequency"]])
    for band, observed in observations:
        best = candidates(band, observed, 1)[0].values
        places = sorted([best["natural_frequency"], best["mode2_frequency"]])
        np.testing.assert_allclose(places, modes, rtol=0.02)
        assert best["delay"] == pytest.approx(truth["delay"], abs=0.01 / observed.band_hz[1])


def test_the_weight_and_the_logarithm_of_noise_are_those_of_a_normal_likelihood(observations):
    """The expectation of −2 log likelihood is least where the noise assumed is the noise there."""
    band, observed = observations[0]
    rows = coarse_rows(band, observed)[0]
    assert np.any(rows.reference > 0.0)
    passed = 2.0 / np.mean(rows.reference[rows.weight > 0.0])
    through = np.full(rows.weight.shape, passed)
    expected_squares = rows.counts * (1.0 + rows.reference * through) / rows.weight

    def expected(ratio):
        weighted = np.sum(rows.weight_at(ratio * through) * expected_squares)
        return float(weighted + rows.log_noise_at(ratio * through))

    assert expected(1.0) < min(expected(0.9), expected(1.1), expected(1e3))

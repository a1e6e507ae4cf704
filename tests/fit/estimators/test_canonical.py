"""An estimate whose two modes exchange their names says the same."""

import numpy as np
import pytest

from vibrident.fit.estimators import Estimate
from vibrident.fit.estimators.canonical import canonically_labelled
from vibrident.fit.estimators.findings import Findings
from vibrident.fit.noise.spectral_noise import SpectralNoise, doubtful
from vibrident.fit.optimise import Trace
from vibrident.fit.problem import Coordinates
from vibrident.physics.models import parse

MODEL = parse("accelerometer+mode2")
#: The second mode has the larger share: a rule calls it the first.
EXCHANGED = {
    "sensitivity": 0.01, "natural_frequency": 30.0, "damping_ratio": 0.04,
    "mode2_frequency": 60.0, "mode2_damping": 0.06, "mode2_gain": 100.0,
}  # fmt: skip


def test_noise_of_the_reference_makes_up_no_more_than_all_of_an_uncertainty(rng):
    """Its pull scales both modes: gain and share move against each other, and exchanged they do, too; it was 438 %."""
    coordinates = Coordinates.at(MODEL, EXCHANGED, (1.0, 50.0))
    pulls = 1e-3 * rng.standard_normal((2, 6))
    covariance = pulls.T @ pulls + np.diag(1e-9 * np.ones(6))
    estimate = Estimate(
        "ipnn", coordinates, coordinates.first, covariance, 100.0,
        Trace("levenberg-marquardt", True, "converged", (1.0,), coordinates.first[None]),
        findings=Findings(noise=SpectralNoise(np.ones(2), doubtful(pulls, covariance), ((), ()), pulls)),
    )  # fmt: skip
    found = canonically_labelled(estimate)
    assert found.coordinates.values(found.z)["natural_frequency"] == pytest.approx(60.0)
    noise = found.findings.noise
    assert noise is not None
    assert np.all(noise.doubt <= 1.0)
    left = found.covariance - noise.pulls.T @ noise.pulls
    assert np.min(np.linalg.eigvalsh(left)) > -1e-12 * np.max(np.abs(found.covariance))

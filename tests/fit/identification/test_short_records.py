"""Records so short that no band of frequencies can be judged: a result with a doubt, never a trace or u = 0."""

from __future__ import annotations

import numpy as np
import pytest

import vibrident
from vibrident.physics.simulation import SENSORS, HalfSineShock, simulate, with_noise

TRUTH = SENSORS["paper"].parameters
NAMES = ("sensitivity", "natural_frequency", "damping_ratio")


def short(kind, samples, seed=1, noise=1e-3):
    motion = [HalfSineShock(9.8, 4e-4, 2e-4)] if kind == "shock" else kind
    band = {} if kind == "shock" else {"frequencies_hz": (300.0, 3000.0)}
    made = simulate("paper", motion, sampling_rate_hz=25_600.0, samples=samples, seed=1, **band)
    return with_noise(made, response_noise=noise, seed=seed)


@pytest.mark.parametrize(("kind", "samples"), [("shock", 20), ("random", 24)])
def test_what_cannot_be_judged_says_so(kind, samples):
    result = vibrident.identify(short(kind, samples))
    assert "lack_of_fit" in result.warning_codes
    assert result.fit.chi2_reduced is None
    text = next(w.message for w in result.warnings if w.code == "lack_of_fit")
    assert text.startswith("It cannot be tested whether the model explains the data")
    if "at_bound" not in result.warning_codes:
        stated = [result.parameters[name].standard_uncertainty for name in NAMES]
        assert all(u is None or u > 0.0 for u in stated)  # None: the data say nothing of it


@pytest.mark.draws(8, 40)
@pytest.mark.parametrize(("kind", "samples"), [("shock", 60), ("sweep", 50)])
def test_what_is_judged_adequate_is_right(kind, samples, draws):
    """Of 40 shocks 37 or more lie within two standard uncertainties in each parameter, of 40 sweeps all."""
    errors = []
    for seed in range(draws):
        result = vibrident.identify(short(kind, samples, seed))
        assert result.fit.adequate
        assert result.fit.chi2_reduced is not None
        found = result.parameters
        errors.append([(found[n].value - TRUTH[n]) / (found[n].standard_uncertainty or np.nan) for n in NAMES])
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all((spread > 0.3) & (spread < 1.6)), spread
    assert np.max(np.abs(errors)) < 4.0


@pytest.mark.draws(8, 20)
def test_the_uncertainty_of_a_short_record_is_that_of_its_noise(draws):
    """Ten times the noise, ten times u; at 90 samples the scatter is what u says."""
    u = [
        [vibrident.identify(short("random", 90, noise=noise)).parameters[n].standard_uncertainty for n in NAMES]
        for noise in (1e-4, 1e-3)
    ]
    np.testing.assert_allclose(np.divide(u[1], u[0]), 10.0, rtol=0.3)
    errors = []
    for seed in range(draws):
        found = vibrident.identify(short("random", 90, seed, noise=1e-4)).parameters
        errors.append([(found[n].value - TRUTH[n]) / found[n].standard_uncertainty for n in NAMES])
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all((spread > 0.6) & (spread < 1.6)), spread

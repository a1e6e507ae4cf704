"""A digital accelerometer that averages: sines beside felt vibration, and prediction."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import chdtri

import vibrident
from vibrident.physics.simulation import simulate

TRUTH = {"sensitivity": 1.0, "natural_frequency": 450.0, "damping_ratio": 0.7, "boxcar_length": 1.7e-3}
MODEL = "accelerometer+boxcar"


def sines(seed: int, **noise: float) -> vibrident.Calibration:
    frequencies = np.geomspace(10.0, 400.0, 10).tolist()
    made = simulate(
        (MODEL, TRUTH), sampling_rate_hz=4000.0, samples=2000, frequencies_hz=frequencies, seed=seed, **noise
    )
    return replace(made, model=MODEL)


@pytest.mark.draws(4, 12)
def test_felt_vibration_is_no_noise_of_the_points(draws: int) -> None:
    """The average had no network: the start and end of what is felt stayed in the tones, and u was too small."""
    pulls = []
    for seed in range(draws):
        result = vibrident.identify(sines(seed, excitation_snr_db=26.0, response_noise=1e-3))
        assert result.fit.adequate
        pulls += [(p.value - TRUTH[n]) / p.standard_uncertainty for n, p in result.parameters.items() if n in TRUTH]
    assert np.sum(np.square(pulls)) < chdtri(len(pulls), 1e-4)


def test_its_response_is_predicted() -> None:
    given = sines(1, response_noise=1e-3)
    told = vibrident.predict(vibrident.identify(given), given)
    for one in told.predictions:
        used = np.isfinite(one.predicted)
        assert used.mean() > 0.85
        assert np.std(one.residual) == pytest.approx(1e-3 * np.std(one.record.response), rel=0.1)

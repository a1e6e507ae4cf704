"""A model that leaves what the motion makes of the response does not explain it, whatever its own residual says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident import identify
from vibrident.fit.response.explained import unexplained
from vibrident.physics.simulation import simulate

P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
MOTIONS = ("random", "sweep", "multisine", "shock")


def without_noise(excitation: str, rng: np.random.Generator):
    made = simulate(
        ("accelerometer", P), excitation, samples=1000, sampling_rate_hz=10e3, repeats=3, seed=int(rng.integers(1000))
    )
    return made.records


@pytest.mark.parametrize("excitation", MOTIONS)
@pytest.mark.parametrize("noise", [1e-4, 0.03, 0.5, 3.0])
def test_the_right_model_leaves_noise_alone(excitation, noise, rng):
    """Noise of either channel, up to three times the response; none in 10 calibrations of three records each."""
    for _ in range(10):
        records = without_noise(excitation, rng)
        share = rng.choice([0.0, 0.3])  # of the noise, that the reference has
        noisy, predicted = [], []
        for record in records:
            own = noise * share * np.std(record.reference) * rng.standard_normal(record.samples)
            y = record.response + noise * np.std(record.response) * rng.standard_normal(record.samples)
            noisy.append(replace(record, reference=record.reference + own, response=y))
            predicted.append(record.response - own * 0.104)
        assert unexplained(noisy, predicted) is None


@pytest.mark.parametrize("excitation", MOTIONS)
@pytest.mark.parametrize("wrong", ["nothing", "late", "half"])
def test_what_is_left_of_the_motion_is_seen(excitation, wrong, rng):
    """A prediction of nothing, one that is 30 samples late, and half of the response, with 1 % of noise."""
    records = without_noise(excitation, rng)
    noisy = [
        replace(r, response=r.response + 0.01 * np.std(r.response) * rng.standard_normal(r.samples)) for r in records
    ]
    made = {"nothing": lambda y: 0.0 * y, "late": lambda y: np.roll(y, 30), "half": lambda y: 0.5 * y}[wrong]
    found = unexplained(noisy, [made(r.response) for r in records])
    assert found is not None
    assert found.left > 10.0 * found.incoherent


def test_a_fit_that_explains_nothing_of_a_shock_is_not_adequate():
    """The response comes 30 samples late and the model has no delay: its own residual was taken for the noise."""
    trial = BY_NAME["lacking/delay/in-light+delay=30/shock/0.1 %"].trial()
    result = identify(trial.calibration(), model=trial.model)
    assert not result.fit.adequate
    assert "lack_of_fit" in result.warning_codes


def test_a_record_of_which_a_delay_leaves_nothing_raises_no_warning():
    """Three cuts in both channels leave a piece that is shorter than the delay that is found in it."""
    trial = BY_NAME["defect/cuts of both channels:3/mixed/below-light/0.1 %"].trial(29)
    assert "clock_suspect" in identify(trial.calibration(), model=trial.model).warning_codes

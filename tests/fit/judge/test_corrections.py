"""Records are corrected for stated effects whose true amount shows above the noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.records import SystematicEffect
from vibrident.physics.simulation import simulate, with_noise
from vibrident.show.tables import corrections

RATE_HZ = 20_000.0
SENSOR = {"sensitivity": 0.104, "natural_frequency": 652.1, "damping_ratio": 0.03}
TIMING = SystematicEffect("skew of the recorder", "timing", 0.05 / RATE_HZ)
GAIN = SystematicEffect("amplifier", "gain", 1.5e-3)


def late_by(amount, *, seed=1, effects=(TIMING,), motion="random"):
    """Return records whose response is late by so many u, with noise far below that."""
    delay_s = amount * TIMING.standard_uncertainty
    sensor = "accelerometer+delay", {**SENSOR, "delay": delay_s}
    hz = [20.0, 3000.0] if motion == "random" else np.geomspace(20.0, 3000.0, 15)
    truth = simulate(sensor, motion, frequencies_hz=hz, sampling_rate_hz=RATE_HZ, samples=4000, seed=seed)
    noisy = with_noise(truth, response_noise=1e-3, seed=seed)
    return replace(noisy, model="accelerometer", effects=effects)


def distances(result):
    """Return the parameters' errors in their standard uncertainties."""
    return [
        (result.parameters[name].value - value) / result.parameters[name].standard_uncertainty
        for name, value in SENSOR.items()
    ]


@pytest.mark.parametrize("motion", ["random", "sine"])
def test_an_amount_that_was_stated_is_found_and_taken_out(motion):
    result = vibrident.identify(late_by(1.6, motion=motion))
    assert result.fit.adequate
    assert result.warning_codes == ()
    (corrected,) = result.settings["corrected_for"]
    u = corrected["standard_uncertainty"]
    assert corrected["amount"] == pytest.approx(1.6 * TIMING.standard_uncertainty, abs=5.0 * u)
    assert u < 0.05 * TIMING.standard_uncertainty
    (shown,) = corrections(result)
    assert shown.startswith("skew of the recorder (timing) of 4")
    assert np.max(np.abs(distances(result))) < 4.0


def test_what_is_left_of_the_effect_is_in_the_budget():
    small, large = (vibrident.identify(late_by(amount)) for amount in (0.0, 1.6))
    by_effect = [
        next(row for row in result.settings["uncertainty_budget"] if row["kind"] == "timing")
        for result in (small, large)
    ]
    assert by_effect[0]["standard_uncertainty"] == TIMING.standard_uncertainty
    assert by_effect[1]["standard_uncertainty"] < 0.05 * TIMING.standard_uncertainty


def test_an_effect_that_the_parameters_follow_keeps_its_statement():
    result = vibrident.identify(late_by(1.6, effects=(TIMING, GAIN)))
    assert result.fit.adequate
    gain = next(row for row in result.settings["uncertainty_budget"] if row["kind"] == "gain")
    assert gain["standard_uncertainty"] == GAIN.standard_uncertainty
    u = result.parameters["sensitivity"].standard_uncertainty
    assert u >= GAIN.standard_uncertainty * SENSOR["sensitivity"]


def test_a_larger_amount_than_was_stated_is_no_correction():
    result = vibrident.identify(late_by(8.0))
    assert not result.fit.adequate
    assert "lack_of_fit" in result.warning_codes


@pytest.mark.draws(4, 40)
def test_parameters_scatter_by_their_uncertainty(draws):
    amounts = np.random.default_rng(4).uniform(1.0, 2.0, draws)
    squares = [
        np.square(distances(vibrident.identify(late_by(amount, seed=seed)))) for seed, amount in enumerate(amounts)
    ]
    # The rms of 3 numbers a draw, within 3.5 of its standard deviations.
    assert np.sqrt(np.mean(squares)) == pytest.approx(1.0, abs=3.5 / np.sqrt(6.0 * draws))

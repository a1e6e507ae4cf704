"""State the cost of places at the coarse bins: the sensor explains them, at any delay and in any noise."""

from __future__ import annotations

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident.fit.problem.band import Band
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.start.coarse import coarse_rows, with_likeliest_noise
from vibrident.fit.start.grid_search import GridSearch, StartCandidate
from vibrident.fit.start.motion_and_noise import estimate_motion_and_noise
from vibrident.fit.start.refinement import CoarseDescent
from vibrident.physics.discretisation import method
from vibrident.physics.models import model_of, parse
from vibrident.physics.simulation import simulate

#: A response that jumps between the ends of its records, as of a sensor far below the motion, and …
BELOW = "quantities/acceleration/accelerometer+mode2=-0.1+delay/burst"
#: … a reference that does, as the displacement of a sweep.
DISPLACEMENT = "quantities/displacement/accelerometer+highpass+delay/sweep"


def at_coarse_bins(calibration, model, values):
    """Return the band at the delay of values, its motion and noise, and the coarse bins."""
    records = calibration.records
    problem = BinProblem.build(records, model, method("bandlimited"), calibration.quantity, values)
    band = Band(problem, np.inf)
    observed = estimate_motion_and_noise(band)
    return band, observed, tuple(coarse_rows(band, observed))


@pytest.mark.parametrize("name", [BELOW, DISPLACEMENT])
def test_the_sensor_explains_the_bins_at_a_delay_that_the_inputs_have_not(name):
    """A circular shift leaks what jumps between the ends; a thousand times the noise without a choice."""
    trial = BY_NAME[name].trial(200)
    calibration = trial.calibration()
    model = model_of(calibration, trial.model)
    truth = {parameter: trial.truth[parameter] for parameter in model.parameter_names}
    band, observed, rows = at_coarse_bins(calibration, model, truth | {"delay": 0.0})
    numbers = sum(np.sum(of_rate.counts) for of_rate in rows)
    place = {key: value for key, value in truth.items() if key not in ("delay", model.gain_name, *model.shares)}
    (found,) = GridSearch(band, observed.band_hz, rows).best([place], 1)
    assert found.cost < 2.0 * numbers
    assert found.values["delay"] == pytest.approx(truth["delay"], abs=0.02 / observed.band_hz[1])
    (end,) = CoarseDescent(band, observed.band_hz, rows).refined([StartCandidate(np.inf, truth)])
    assert end.cost < 2.0 * numbers


def test_noise_that_is_known_to_be_too_high_ranks_places_as_the_true_noise_would():
    """Where every place seems to explain the bins, a place that leaves half as much gains N log 2."""
    model = parse("accelerometer")
    calibration = simulate("paper", "random", samples=2000, response_noise=1e-3, seed=1)
    start = dict.fromkeys(model.parameter_names, 1.0)
    _, _, rows = at_coarse_bins(calibration, model, start)
    numbers = sum(np.sum(of_rate.counts) for of_rate in rows)
    low = with_likeliest_noise(rows, np.array([1e-3, 2e-3]) * numbers)
    assert np.diff(low)[0] == pytest.approx(numbers * np.log(2.0))
    high = np.array([1.0, 2.0, np.inf]) * numbers
    np.testing.assert_allclose(with_likeliest_noise(rows, high), high)
    assert np.all(np.diff(with_likeliest_noise(rows, np.linspace(0.0, 3.0, 50) * numbers)) > 0.0)

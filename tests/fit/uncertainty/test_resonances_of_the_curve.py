"""The stated curve meets every peak, however sharp the resonance is."""

import numpy as np
import pytest

from vibrident.fit.uncertainty.curve import POINTS, frequencies, with_resonances
from vibrident.physics.models import parse

SHARP = {"sensitivity": 0.1, "natural_frequency": 652.0, "damping_ratio": 0.002}
TWO = {**SHARP, "mode2_frequency": 2400.0, "mode2_damping": 0.0005, "mode2_gain": 0.05}


def interpolated(model, parameters, grid, where):
    """The curve between its points, as a picture draws it."""
    return np.interp(where, grid, np.abs(model.frequency_response(parameters, grid)))


@pytest.mark.parametrize("damping", [0.05, 0.01, 1e-3, 1e-4])
def test_the_drawn_curve_is_within_two_percent_of_the_model_at_any_damping(damping):
    model, parameters = parse("accelerometer"), {**SHARP, "damping_ratio": damping}
    grid = with_resonances(frequencies((10.0, 5000.0)), model.rational(parameters))
    fine = 652.0 * (1.0 + damping * np.linspace(-40.0, 40.0, 4001))
    fine = fine[(fine > 10.0) & (fine < 5000.0)]
    exact = np.abs(model.frequency_response(parameters, fine))
    off = interpolated(model, parameters, grid, fine) / exact - 1.0
    assert np.max(np.abs(off)) < 0.02
    assert interpolated(model, parameters, grid, fine).max() > 0.999 * exact.max()


def test_every_mode_has_its_points_and_a_damped_sensor_none():
    model = parse("accelerometer+mode2")
    grid = with_resonances(frequencies((10.0, 5000.0)), model.rational(TWO))
    for name in ("natural_frequency", "mode2_frequency"):
        assert np.min(np.abs(grid / TWO[name] - 1.0)) < 1e-5
    assert np.all(np.diff(grid) > 0)
    assert grid.size < 3 * POINTS
    damped = parse("accelerometer").rational({**SHARP, "damping_ratio": 0.2})
    assert with_resonances(frequencies((10.0, 5000.0)), damped).size == POINTS
    outside = with_resonances(frequencies((10.0, 300.0)), model.rational(TWO))
    assert outside.size == POINTS

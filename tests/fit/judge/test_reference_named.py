"""A reference that is a sensor itself, and of which nothing is stated: the message names it as a cause."""

import re

import numpy as np
import pytest
from tests.support.known_channels import Motion, seismometer

from vibrident import Calibration, identify
from vibrident.fit.judge.reference import BesideOscillator
from vibrident.fit.problem import Coordinates
from vibrident.physics.models import parse


@pytest.mark.parametrize(("corner_hz", "samples"), [(1.0 / 120.0, 30_000), (1.0 / 30.0, 10_000)], ids=["120-s", "30-s"])
@pytest.mark.quick("30-s")
def test_a_huddle_test_without_the_broadbands_response_names_the_reference(corner_hz, samples):
    motion = Motion("random", samples, 100.0, (0.02, 30.0), seed=4)
    reference, response = (
        motion.channel(seismometer(1.0, corner_hz, 0.707)),
        motion.channel(seismometer(30.0, 1.0, 0.6)),
    )
    result = identify(
        Calibration.from_arrays(
            [reference],
            [response + 1e-3 * np.std(response) * motion.rng.normal(size=samples)],
            100.0,
            quantity="velocity",
            excitation="random",
            model="velocity-pickup",
        )
    )
    (message,) = (warning.message for warning in result.warnings if warning.code == "lack_of_fit")
    found = re.search(r"an oscillator of about (\S+) Hz with damping \S+: if it is a sensor, state its known", message)
    assert found is not None
    assert 0.4 * corner_hz < float(found[1]) < 2.5 * corner_hz


@pytest.mark.parametrize("above", [True, False])
def test_slopes_beside_an_oscillator_are_those_of_the_deviations(above):
    """Against central differences, for the model's coordinates and for the oscillator's logarithms."""
    hz = np.geomspace(10.0, 1000.0, 12)
    values = {"sensitivity": 0.1, "natural_frequency": 300.0, "damping_ratio": 0.3}
    model = parse("accelerometer")
    coordinates = Coordinates.at(model, values, (10.0, 1000.0))
    measured = 0.9 * model.frequency_response(values, hz, "acceleration")
    points = BesideOscillator(coordinates, "acceleration", hz, measured, np.full(hz.size, 1e-3), above)
    x = np.append(coordinates.first, np.log([700.0, 0.2]))
    steps = 1e-6 * np.eye(x.size)
    differences = np.stack([(points.at(x + step)[0] - points.at(x - step)[0]) / 2e-6 for step in steps], axis=1)
    assert points.at(x)[1] == pytest.approx(differences, rel=1e-5, abs=1e-2)

"""Far from a resonance the descent follows the narrow valley of parameters that trade."""

import numpy as np
import pytest

import vibrident
from vibrident import Calibration
from vibrident.fit.problem import Coordinates
from vibrident.physics.models import parse

RATE_HZ = 10_000.0
SAMPLES = 4000


@pytest.mark.parametrize("factor", [1.3, 0.4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_step_keeps_products_of_powers(factor, sign):
    """A step that changes no product of powers to first order changes none at all."""
    start = {"generator_constant": 3.0 * sign, "natural_frequency": 200.0, "damping_ratio": 0.02}
    coordinates = Coordinates.at(parse("velocity-pickup"), start, (10.0, 100.0))
    z = coordinates.first
    logarithms = 0.5 * np.log(factor) * np.array([2.0, 1.0, 1.0])
    values = np.array([coordinates.values(z)[name] for name in start])
    moved = coordinates.values(coordinates.moved(z, logarithms * values / coordinates.slopes(z)))
    by_stiffness = moved["generator_constant"] / moved["natural_frequency"] ** 2
    assert by_stiffness == pytest.approx(3.0 * sign / 200.0**2, rel=1e-12)
    assert moved["damping_ratio"] / moved["natural_frequency"] == pytest.approx(1e-4, rel=1e-12)


def test_a_step_may_change_the_sign():
    start = {"sensitivity": 1.0, "natural_frequency": 200.0, "damping_ratio": 0.02}
    coordinates = Coordinates.at(parse("accelerometer"), start, (10.0, 100.0))
    z = coordinates.first
    step = np.array([-3.0, 0.1, -0.05])
    np.testing.assert_array_equal(coordinates.moved(z, step), z + step)


@pytest.mark.parametrize("model", ["velocity-pickup", "accelerometer"])
def test_a_sensor_far_above_the_motion_is_found(model, rng):
    """Tones to 1/25 of the natural frequency; the gain over fn² is known 10⁴ times better than fn is."""
    natural_hz = 25.0 * 2000.0
    name = parse(model).gain_name
    true = {name: 0.7, "natural_frequency": natural_hz, "damping_ratio": 0.5}
    frequencies_hz = np.geomspace(50.0, 2000.0, 15)
    s = 2j * np.pi * frequencies_hz
    omega = 2.0 * np.pi * natural_hz
    top = s if model == "velocity-pickup" else omega**2
    sensor = 0.7 * top / (s * s + omega * s + omega**2)
    waves = np.exp(np.outer(s, np.arange(SAMPLES) / RATE_HZ) + 2j * np.pi * rng.random((15, 1)))
    reference, response = waves.real.sum(axis=0), (sensor @ waves).real
    response = response + 1e-5 * response.std() * rng.standard_normal(SAMPLES)
    calibration = Calibration.from_arrays(reference, response, RATE_HZ, quantity="acceleration", excitation="multisine")
    result = vibrident.identify(calibration, model=model)
    assert result.fit.adequate
    for parameter_name, value in true.items():
        parameter = result.parameters[parameter_name]
        assert abs(parameter.value - value) < 4.0 * parameter.standard_uncertainty, parameter_name

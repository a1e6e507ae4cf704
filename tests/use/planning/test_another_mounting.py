"""Another coupling stiffness, another mass: fm goes with √(k/m), and S with it, with its uncertainty."""

import numpy as np
import pytest
from tests.support.mounted import COUPLING, SENSOR, table
from tests.support.shell import run

import vibrident
from vibrident.base.errors import InputError
from vibrident.physics.models import parse

HZ = np.geomspace(1e3, 25e3, 10)


@pytest.fixture(scope="module")
def mounted() -> vibrident.Result:
    return vibrident.identify(table(1, "accelerometer+mounting:0.25", SENSOR | COUPLING))


def test_four_times_the_stiffness_doubles_the_frequency_and_halves_the_damping(mounted):
    found = vibrident.predict_mounted(mounted, stiffness=4.0, frequencies_hz=HZ)
    stiffer = SENSOR | {"mounting_frequency": 60e3, "mounting_damping": 0.015}
    expected = np.abs(parse("accelerometer+mounting:0.25").frequency_response(stiffer, HZ))
    assert np.all(np.abs(found.predicted.magnitude - expected) < 4 * found.predicted.magnitude_uncertainty)
    assert found.sensor.values["mounting_frequency"] == pytest.approx(60e3, rel=1e-3)


def test_a_mass_on_the_housing_lowers_frequency_and_mass_ratio(mounted):
    """0.25 of 1.25 kg is seismic; with 1.25 kg more the housing has 2.25 kg, and the whole mass is twice as large."""
    found = vibrident.predict_mounted(mounted, mass=2.0, frequencies_hz=HZ)
    assert found.sensor.values["mounting_frequency"] == pytest.approx(30e3 / 2**0.5, rel=1e-3)
    assert found.sensor.model.name == f"accelerometer+mounting:{float(f'{1 / 9:.12g}')!r}"
    # The seismic mass on its spring is what it was.
    assert found.sensor.values["natural_frequency"] == mounted.parameters["natural_frequency"].value


def test_the_uncertainty_is_that_of_the_parameters_by_drawing(mounted, rng):
    found = vibrident.predict_mounted(mounted, stiffness=1.5, frequencies_hz=HZ)
    sensor = mounted.to_sensor()
    draws = rng.multivariate_normal([*sensor.values.values()], sensor.covariance, 4000)
    responses = []
    for draw in draws:
        values = dict(zip(sensor.values, draw, strict=True))
        values["mounting_frequency"] *= 1.5**0.5
        values["mounting_damping"] *= 1.5**-0.5
        responses.append(np.abs(sensor.model.frequency_response(values, HZ)))
    np.testing.assert_allclose(found.predicted.magnitude_uncertainty, np.std(responses, axis=0), rtol=0.06)


def test_a_sensor_of_a_rigid_mounting_is_put_on_a_stated_one():
    fixed = vibrident.identify(table(1, "accelerometer", SENSOR))
    found = vibrident.predict_mounted(fixed, frequency_hz=30e3, standard_uncertainty=0.02, frequencies_hz=[10e3])
    ratio = 1 / 9
    assert found.change == pytest.approx(ratio / (1 - ratio), rel=1e-9)
    relative = found.predicted.magnitude_uncertainty / found.predicted.magnitude
    assert relative == pytest.approx(0.04 * ratio / (1 - ratio), rel=0.02)


def test_what_cannot_be_mounted_says_why(mounted):
    fixed = vibrident.identify(table(1, "accelerometer", SENSOR))
    for result, stated, says in (
        (fixed, {"stiffness": 2.0}, "has no mounting"),
        (mounted, {"mass": 0.1}, "lighter than its seismic mass"),
        (mounted, {"stiffness": 0.0}, "cannot be used"),
        (mounted, {"frequency_hz": 1e4, "damping": -1.0}, "cannot be used"),
    ):
        with pytest.raises(InputError, match=says):
            vibrident.predict_mounted(result, **stated)


def test_the_command_writes_the_curves(mounted, tmp_path):
    mounted.save(tmp_path / "result.json")
    done = run("plan", "--from", tmp_path / "result.json", "--mounting-stiffness", "4", "--out", tmp_path / "plan")
    assert done.exit_code == 0
    assert "on another mounting" in done.output
    columns = np.genfromtxt(tmp_path / "plan" / "mounting.csv", delimiter=",", names=True)
    assert columns["frequency_hz"][0] == pytest.approx(1000.0)
    assert np.all(columns["change_percent"][columns["frequency_hz"] < 20e3] < 0.0)
    assert (tmp_path / "plan" / "mounting.png").is_file()
    refused = run("plan", "--mounting-mass", "2")
    assert refused.exit_code == 2
    assert "--from RESULT" in refused.output

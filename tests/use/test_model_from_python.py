"""A model given as one Python object: right with u, refused in one sentence, read back without it."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from tests.support.models_of_others import (
    SENSORS,
    Sensor,
    convective,
    force_sensor,
    helmholtz,
    measured,
    pressure_line,
    response_at,
    rlc,
)
from tests.support.sources import ROOT

from vibrident import (
    Calibration,
    IdentifiedSensor,
    InputError,
    Model,
    ModelError,
    ParameterSpec,
    ResponseTable,
    Result,
    identify,
    identify_many,
)
from vibrident.physics.models import SensorModel

GAIN = ParameterSpec("gain", "V/Pa")
LAG = ParameterSpec("lag", "s", start=1e-3)


def identified(sensor: Sensor, seed: int = 0) -> Result:
    rng = np.random.default_rng([seed, SENSORS.index(next(s for s in SENSORS if s().model.name == sensor.model.name))])
    return identify(Calibration.from_arrays(**measured(sensor, rng)), model=sensor.model)


def deviations(result: Result, sensor: Sensor) -> np.ndarray:
    """Of the parameters from the true values, in u."""
    pairs = [(result.parameters[name], true) for name, true in sensor.values.items()]
    return np.array([(each.value - true) / each.standard_uncertainty for each, true in pairs])


@pytest.mark.parametrize("make", SENSORS, ids=lambda make: make.__name__)
def test_a_formula_is_the_response_of_the_equations_of_motion(make):
    sensor = make()
    at = np.geomspace(sensor.top_hz / 300.0, sensor.top_hz, 40)
    model = sensor.model + "delay"
    response = model.frequency_response({**sensor.values, "delay": 0.0}, at)
    assert response == pytest.approx(response_at(sensor, at), rel=1e-9)


def test_ten_models_of_others_are_right_with_u():
    """All within 4 u, and u of the size of the scatter: its square within 4 σ of a mean of squares of one."""
    off = []
    for make in SENSORS:
        sensor = make()
        result = identified(sensor)
        assert not result.warnings, (sensor.model, result.warnings)
        off.append(deviations(result, sensor))
        assert np.max(np.abs(off[-1])) < 4.0, (sensor.model, off[-1])
    every = np.concatenate(off)
    assert every.size == 35
    assert np.mean(every**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / every.size))


@pytest.mark.slow
@pytest.mark.parametrize("make", [convective, force_sensor, pressure_line], ids=lambda make: make.__name__)
def test_u_is_the_scatter_of_a_model(make):
    """The mean square of the deviations in u is one, within 4 σ; the last model is a filter."""
    sensor = make()
    off = np.array([deviations(identified(sensor, seed), sensor) for seed in range(1, 61)])
    assert np.mean(off**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / len(off)))


def tabulated(sensor: Sensor) -> Calibration:
    """A table of the response with 0.1 % and 1 mrad of noise."""
    at = np.geomspace(0.04 * sensor.top_hz, sensor.top_hz, 60)
    response = response_at(sensor, at)
    noise = 1e-3 * np.random.default_rng(2).standard_normal((2, at.size))
    table = ResponseTable(
        at,
        np.abs(response) * (1.0 + noise[0]),
        np.angle(response) + noise[1],
        magnitude_uncertainty=1e-3 * np.abs(response),
        phase_uncertainty_rad=np.full(at.size, 1e-3),
    )
    return Calibration(table=table, quantity="drive", reference_unit=sensor.unit)


def test_a_table_of_a_models_response_gives_its_parameters():
    sensor = helmholtz()
    result = identify(tabulated(sensor), model=sensor.model)
    assert np.max(np.abs(deviations(result, sensor))) < 4.0
    assert result.fit.adequate


def test_a_model_takes_add_ons():
    sensor = convective()
    record = measured(sensor, np.random.default_rng(5))
    result = identify(Calibration.from_arrays(**record), model=sensor.model + "delay")
    assert result.model == "convective+delay"
    assert abs(result.parameters["delay"].value) < 4.0 * result.parameters["delay"].standard_uncertainty


def test_a_function_that_is_not_rational_fits_as_its_rational_twin():
    """A factor of e^0 hides the ratio, so that the same response is taken as a filter."""
    sensor = convective()
    twin = Model(
        "convective-filter",
        lambda s, sensitivity, cutoff: sensitivity / (1 + s / (2 * np.pi * cutoff)) * np.exp(0 * s),
        [ParameterSpec("sensitivity", "V/(m/s^2)"), ParameterSpec("cutoff", "Hz")],
    )
    assert sensor.model.is_rational
    assert not twin.is_rational
    calibration = Calibration.from_arrays(**measured(sensor, np.random.default_rng(6)))
    results = [identify(calibration, model=model) for model in (sensor.model, twin)]
    for name in sensor.values:
        one, other = (result.parameters[name] for result in results)
        assert other.value == pytest.approx(one.value, abs=one.standard_uncertainty)
        assert other.standard_uncertainty == pytest.approx(one.standard_uncertainty, rel=0.2)


def test_what_a_model_does_not_explain_is_told():
    first_order = Model("first-order", lambda s, gain, lag: gain / (1 + s * lag), [GAIN, LAG])
    result = identify(tabulated(helmholtz()), model=first_order)
    assert "lack_of_fit" in result.warning_codes


def test_poles_and_zeros_follow_and_are_refused_where_there_are_none():
    sensor = identify(tabulated(rlc()), model=rlc().model).to_sensor().to_scipy()
    true = np.roots([4.7e-3, 50.0, 1 / 2.2e-7])
    assert np.sort_complex(sensor.poles) == pytest.approx(np.sort_complex(true), rel=1e-2)
    filtered = Model("filtered", lambda s, gain, lag: gain * np.exp(-s * lag), [GAIN, LAG])
    known = IdentifiedSensor(
        SensorModel(filtered.name, filtered), {"gain": 1.0, "lag": 1e-3}, np.zeros((2, 2)), band_hz=(1.0, 9.0)
    )
    with pytest.raises(InputError, match="Poles and zeros cannot hold the model 'filtered'"):
        known.to_scipy()


REFUSED = {
    "is no function.": lambda: Model("m", 3.0, [GAIN]),
    "cannot be the name": lambda: Model("two words", lambda s, gain: gain, [GAIN]),
    "has no list of parameters": lambda: Model("m", lambda s, gain: gain, ["gain"]),
    "has a name twice": lambda: Model("m", lambda s, gain: gain, [GAIN, GAIN]),
    "is no function of s and the parameters": lambda: Model("m", lambda s, height: height, [GAIN]),
    "cannot be computed": lambda: Model("m", lambda s, gain, lag: gain / math.sqrt(lag), [GAIN, LAG]),  # noqa: F821
    "cannot be differentiated": lambda: Model("m", lambda s, gain, lag: gain / (1 + s * abs(lag)), [GAIN, LAG]),
    "has no gain": lambda: Model("m", lambda s, gain, lag: gain + s * lag, [GAIN, LAG]),
    "has several gains": lambda: Model("m", lambda s, gain, lag: gain * lag * s, [GAIN, LAG]),
    "needs a start value": lambda: Model(
        "m", lambda s, gain, lag: gain / (1 + s * lag), [GAIN, ParameterSpec("lag", "s")]
    ),
    "needs bounds": lambda: Model(
        "m", lambda s, gain, lag: gain / (1 + s * lag), [GAIN, ParameterSpec("lag", "s", start=-1.0)]
    ),
    "outside its bounds": lambda: Model(
        "m", lambda s, gain, lag: gain / (1 + s * lag), [GAIN, ParameterSpec("lag", "s", start=1.0, bounds=(2.0, 3.0))]
    ),
    "This is no sensor model": lambda: identify(Calibration.from_arrays([0.0] * 9, [0.0] * 9, 1.0), model=3),
    "name 'accelerometer' is taken": lambda: identify(
        Calibration.from_arrays([0.0] * 9, [0.0] * 9, 1.0),
        model=Model("accelerometer", lambda s, gain, lag: gain / (1 + s * lag), [GAIN, LAG]),
    ),
    "cannot go to other processes": lambda: next(identify_many([], model=convective().model, workers=2)),
}


@pytest.mark.parametrize("sentence", REFUSED)
def test_what_is_no_model_is_refused_in_one_sentence(sentence):
    with pytest.raises(ModelError) as refused:
        REFUSED[sentence]()
    first, *rest = str(refused.value).splitlines()
    assert sentence in first
    assert [line.split(":")[0].strip() for line in rest] == ["expected", "found", "where", "remedy"]


READ = """
import numpy as np, sys, vibrident
result = vibrident.Result.load("result.json")
curve = float(np.sum(result.response.magnitude))
print(repr(result.parameters["cutoff"].value), curve, result.provenance["model"]["formula"])
try:
    result.to_sensor()
except vibrident.ModelError as error:
    print(error)
from tests.support.models_of_others import convective
print(vibrident.Result.load("result.json", model=convective().model).to_sensor())
"""


def test_a_result_is_read_without_its_model_and_computes_with_it(tmp_path):
    result = identified(convective())
    result.save(tmp_path / "result.json")
    done = subprocess.run(
        [sys.executable, "-c", READ],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    first, second, *_, last = done.stdout.splitlines()
    assert first == (
        f"{result.parameters['cutoff'].value!r} {float(np.sum(result.response.magnitude))} "
        "lambda s, sensitivity, cutoff: sensitivity / (1 + s / (TURN * cutoff))"
    )
    assert second == "The model 'convective' was made in Python and is not known here."
    assert last == repr(result.to_sensor())
    assert result.provenance["model"]["constants"] == {"TURN": 2 * np.pi}


def test_another_formula_of_the_same_name_does_not_compute_for_a_result():
    calibration = Calibration.from_arrays(**measured(convective(), np.random.default_rng(8)))
    parameters = [ParameterSpec("gain", "V/(m/s^2)"), LAG]
    first = identify(calibration, model=Model("mine", lambda s, gain, lag: gain / (1 + s * lag), parameters))
    first.to_sensor()
    identify(calibration, model=Model("mine", lambda s, gain, lag: gain / (1 + 2 * s * lag), parameters))
    with pytest.raises(ModelError, match="is another one here"):
        first.to_sensor()

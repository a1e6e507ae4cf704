"""The FMU run by fmpy: its outputs against the model over the band, and its constants against the result."""

from __future__ import annotations

import sys
import zipfile

import numpy as np
import pytest
from tests.support.exported import case, paper

from vibrident.base.errors import InputError
from vibrident.export import export
from vibrident.export.sensor import read_sensor

RATES = {"paper": 51200.0, "mems": 51200.0, "coil": 1000.0}


def run(path, samples, rate, outputs):
    import fmpy

    n = len(samples)
    t = np.arange(n) / rate
    signal = np.zeros(n, dtype=[("time", float), ("input", float)])
    signal["time"], signal["input"] = t, samples
    found = fmpy.simulate_fmu(
        str(path),
        stop_time=(n - 1) / rate,
        step_size=1 / rate,
        output_interval=1 / rate,
        input=signal,
        output=outputs,
        fmi_type="CoSimulation",
    )
    return {name: found[name] for name in outputs}


@pytest.mark.parametrize("name", RATES)
def test_fmu_run_by_fmpy_is_the_model_over_the_band(name, tmp_path):
    made, rate = case(name), RATES[name]
    sensor = read_sensor(made)
    (path,) = export(made, "fmu", tmp_path, rate_hz=rate)
    n = 6000
    impulse = np.zeros(n)
    impulse[1] = 1.0
    names = ["response", "response_cell", "response_latency", *made.parameters, *(f"{p}_u" for p in made.parameters)]
    out = run(path, impulse, rate, names)
    f = np.geomspace(*sensor.band_hz, 30)
    turn = np.exp(-2j * np.pi * np.outer(f, np.arange(n) - 1) / rate)
    late = np.exp(-2j * np.pi * f * out["response_latency"][0])
    np.testing.assert_allclose(turn @ out["response"], sensor.response(f) * late, rtol=1e-9)
    if name == "paper":  # no delay, no boxcar: the cell is the sensor to the accuracy of first-order hold
        cell = turn @ out["response_cell"] / (sensor.response(f) * np.exp(-2j * np.pi * f / rate))
        np.testing.assert_allclose(np.abs(cell - 1.0), 1 - np.sinc(f / rate) ** 2, rtol=0.05, atol=1e-6)
    for key, p in made.parameters.items():
        assert out[key][0] == p.value
        assert out[f"{key}_u"][0] == p.standard_uncertainty


def test_fmu_is_valid_and_says_what_it_holds(tmp_path):
    import fmpy
    from fmpy.validation import validate_fmu

    before = list(sys.path)
    (path,) = export(case("late"), "fmu", tmp_path, rate_hz=51200.0)
    assert sys.path == before
    assert list(tmp_path.iterdir()) == [path]
    assert validate_fmu(str(path)) == []
    description = fmpy.read_model_description(str(path))
    assert not description.coSimulation.canHandleVariableCommunicationStepSize
    with zipfile.ZipFile(path) as archive:
        text = archive.read("documentation/sensor.txt").decode()
    assert "the outputs carry none" in text
    assert "without delay" in text
    for p in case("late").parameters.values():
        assert repr(p.value) in text


def test_another_step_than_the_fixed_one_fails(tmp_path):
    (path,) = export(paper(), "fmu", tmp_path, rate_hz=51200.0)
    with pytest.raises(Exception, match="fmi2DoStep"):
        run(path, np.zeros(10), 25600.0, ["response"])


def test_a_rate_is_needed(tmp_path):
    with pytest.raises(InputError, match="needs a sampling rate"):
        export(paper(), "fmu", tmp_path)

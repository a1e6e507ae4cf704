"""What users of Python are promised: the calls of the contract, and short representations."""

import re

import numpy as np
import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.io import write_calibration
from vibrident.physics.simulation import simulate
from vibrident.result import Result

P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182, "delay": 2e-5}


@pytest.fixture(scope="module")
def calibration():
    shape = {"sampling_rate_hz": 10e3, "samples": 2000, "start": "steady", "response_noise": 0.01, "seed": 4}
    return simulate(("accelerometer+delay", P), frequencies_hz=[63.1, 251.0, 631.0, 1010.0], **shape)


@pytest.fixture(scope="module")
def result(calibration):
    return vibrident.identify(calibration)


def test_a_calibration_of_arrays_gives_the_same_result_as_the_one_that_they_are_from(calibration, result):
    records = calibration.records
    again = vibrident.Calibration.from_arrays(
        [r.reference for r in records], [r.response for r in records], 10e3, model="accelerometer+delay"
    )
    assert vibrident.identify(again).parameters == result.parameters


def test_one_record_of_arrays_may_be_one_dimensional(calibration):
    record = calibration.records[0]
    one = vibrident.Calibration.from_arrays(record.reference, record.response, 10e3, excitation="random")
    assert [r.excitation for r in one.records] == ["random"]
    np.testing.assert_array_equal(one.records[0].response, record.response)
    decay = vibrident.Calibration.from_arrays(None, list(record.response), 10e3, excitation="decay")
    assert decay.records[0].reference is None


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"reference": np.ones((3, 100))}, "reference"),
        ({"sampling_rate_hz": [1.0, 2.0, 3.0]}, "sampling_rate_hz"),
        ({"excitation": ["sine"]}, "excitation"),
        ({"names": ["a"]}, "name"),
    ],
)
def test_arrays_of_different_numbers_of_records_are_refused(change, named):
    both = {"reference": np.ones((2, 100)), "response": np.ones((2, 100)), "sampling_rate_hz": 100.0}
    with pytest.raises(InputError, match=f"one {named} a record"):
        vibrident.Calibration.from_arrays(**both | change)


def test_a_path_is_identified_as_the_calibration_that_it_holds(calibration, result, tmp_path):
    path = write_calibration(tmp_path, calibration)
    assert vibrident.identify(str(path)).parameters["delay"].value == pytest.approx(
        result.parameters["delay"].value, rel=1e-6
    )
    missing = tmp_path / "missing.toml"
    one, refused = vibrident.identify_many([path, missing], refused="return")
    assert one.parameters["delay"].value == pytest.approx(result.parameters["delay"].value, rel=1e-6)
    assert isinstance(refused, InputError)


def test_the_summary_is_what_the_terminal_shows(result):
    text = result.summary()
    assert {"sensitivity", "natural frequency", "damping ratio", "delay", "adequate"} <= set(
        re.findall(r"sensitivity|natural frequency|damping ratio|delay|adequate", text)
    )
    assert max(map(len, text.splitlines())) <= 100
    assert "\x1b" not in text


def test_the_data_frame_holds_every_parameter(result):
    frame = result.to_dataframe()
    assert list(frame.index) == list(result.parameters)
    for name, each in result.parameters.items():
        assert frame.loc[name, "value"] == each.value
        assert frame.loc[name, "standard_uncertainty"] == each.standard_uncertainty
    assert frame["value"].dtype == float


def test_a_picture_is_drawn_or_refused_by_name(result):
    assert result.plot().axes
    assert result.plot("residuals").axes
    with pytest.raises(InputError, match="no such picture"):
        result.plot("portrait")


def test_the_sensor_is_the_same_in_other_libraries(result):
    control = pytest.importorskip("control")
    sensor = result.to_sensor()
    frequency = np.array([70.0, 500.0, 1000.0])
    wanted = sensor.frequency_response(frequency)
    system = sensor.to_scipy()
    np.testing.assert_allclose(system.freqresp(2 * np.pi * frequency)[1], wanted, rtol=1e-9)
    assert isinstance(sensor.to_control(), control.TransferFunction)
    np.testing.assert_allclose(sensor.to_control()(2j * np.pi * frequency), wanted, rtol=1e-9)
    assert sensor.covariance.shape == (4, 4)


def test_representations_are_short(calibration, result):
    record = calibration.records[0]
    longer = vibrident.simulate(excitation="random", samples=16000)
    plan = vibrident.plan(result)
    corrected, predicted = vibrident.correct(result, calibration), vibrident.predict(result, calibration)
    shown = [calibration, longer, record, longer.records[0], record.provenance, result, result.to_sensor(), plan]
    shown += [result.response, result.measured, result.training, result.correlation, result.fit, *result.signals]
    shown += [corrected, corrected.corrections[0], predicted, predicted.predictions[0], vibrident.Ipnn()]
    shown += [vibrident.MaximumLikelihood(), vibrident.LeastSquares(), *result.parameters.values()]
    too_long = [type(each).__name__ for each in shown if len(repr(each)) > 2000]
    assert not too_long
    assert repr(result.parameters["delay"].value)[:6] in repr(result)


def test_curves_are_arrays_that_survive_the_file(result, tmp_path):
    again = Result.load(result.save(tmp_path / "result.json"))
    for curve, other in ((result.response, again.response), (result.measured, again.measured)):
        assert curve == other
        assert isinstance(curve.magnitude, np.ndarray)
        assert curve.magnitude.shape == curve.frequency_hz.shape == curve.phase_deg_uncertainty.shape
        with pytest.raises(ValueError, match="read-only"):
            curve.magnitude[0] = 0.0
    np.testing.assert_array_equal(again.signals[0].predicted, result.signals[0].predicted)

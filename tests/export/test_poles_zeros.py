"""Poles and zeros against the model's own frequency response, and the formats made of them against their readers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.support.exported import CASES, PAPER, case, paper, result

from vibrident.base.errors import InputError
from vibrident.export import export
from vibrident.export.approximation import approximate
from vibrident.export.poles_zeros import poles_zeros, roots, uncertainties
from vibrident.export.sensor import read_sensor
from vibrident.physics.models import parse

# ObsPy 1.5 looks its plug-ins up in a way that Python 3.11 warns of.
pytestmark = pytest.mark.filterwarnings("ignore:SelectableGroups:DeprecationWarning")
TOLERANCE = 1e-9


def model_response(made, f, quantity="acceleration"):
    values = {name: made.parameters[name].value for name in parse(made.model).parameter_names}
    return parse(made.model).frequency_response(values, f, quantity)


@pytest.mark.parametrize("name", CASES)
def test_poles_and_zeros_are_the_model(name):
    made = case(name)
    sensor = read_sensor(made)
    f = sensor.band
    own = poles_zeros(sensor)
    rational = sensor.without(sensor.apart)
    np.testing.assert_allclose(own.response(f), rational.response(f), rtol=1e-12)
    assert np.all(own.poles.real <= 0)
    whole, words = approximate(sensor)
    np.testing.assert_allclose(whole.response(f), model_response(made, f), rtol=1e-10)
    assert np.all(whole.poles.real <= 0)
    assert bool(words) == bool(sensor.apart)


def test_roots_far_apart_are_exact():
    """(s + 0.5)(s + 2e5)(s + 3e3): a companion matrix alone loses the small root's digits."""
    wanted = np.array([-0.5, -3e3, -2e5])
    found = np.sort(roots(np.poly(wanted)[::-1]).real)[::-1]
    np.testing.assert_allclose(found, wanted, rtol=1e-13)


def test_uncertainty_of_poles_is_that_of_a_monte_carlo():
    made = case("late", relative=1e-3)
    sensor = read_sensor(made)
    names = made.correlation.names
    deviation = np.array([made.parameters[n].standard_uncertainty for n in names])
    covariance = np.array(made.correlation.matrix) * np.outer(deviation, deviation)
    rng = np.random.default_rng(1)
    draws = rng.multivariate_normal([sensor.values[n] for n in names], covariance, 4000)
    sensors = [replace(sensor.identified, values=dict(zip(names, draw, strict=True))) for draw in draws]
    poles = np.array([poles_zeros(replace(sensor, identified=drawn)).poles for drawn in sensors])
    u = uncertainties(sensor, "poles")
    np.testing.assert_allclose(u.real, poles.real.std(0), rtol=0.05)
    np.testing.assert_allclose(u.imag, poles.imag.std(0), rtol=0.05)


@pytest.mark.parametrize("name", CASES)
def test_objects_of_control_and_scipy_evaluate_to_the_model(name):
    from scipy import signal

    made = case(name)
    f = read_sensor(made).band
    wanted = model_response(made, f)
    sensor = made.to_sensor()
    np.testing.assert_allclose(sensor.to_control()(2j * np.pi * f), wanted, rtol=TOLERANCE)
    np.testing.assert_allclose(signal.freqresp(sensor.to_scipy(), 2 * np.pi * f)[1], wanted, rtol=TOLERANCE)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
def test_stationxml_evaluated_by_obspy_is_the_model(name, quantity, tmp_path):
    import obspy

    made = case(name, quantity=quantity)
    f = read_sensor(made).band
    (path,) = export(made, "stationxml", tmp_path)
    channel = obspy.read_inventory(str(path))[0][0][0]
    for output, motion in (("ACC", "acceleration"), ("VEL", "velocity"), ("DISP", "displacement")):
        found = channel.response.get_evalresp_response_for_frequencies(f, output=output)
        np.testing.assert_allclose(found, model_response(made, f, motion), rtol=TOLERANCE)
    text = " ".join(comment.value for comment in channel.comments)
    for p in made.parameters.values():
        assert repr(p.value) in text
        assert repr(p.standard_uncertainty) in text
    sensitivity = channel.response.instrument_sensitivity
    per = "velocity" if name.startswith("coil") else "acceleration"
    assert sensitivity.input_units == {"velocity": "M/S", "acceleration": "M/S**2"}[per]
    at = model_response(made, np.array([sensitivity.frequency]), per)[0]
    assert sensitivity.value == pytest.approx(
        np.copysign(abs(at), next(iter(made.parameters.values())).value), rel=1e-12
    )
    pole = channel.response.response_stages[0].poles[0]
    assert pole.upper_uncertainty is not None


@pytest.mark.parametrize("name", CASES)
def test_sacpz_evaluated_by_obspy_is_the_model(name, tmp_path):
    import obspy
    from obspy.io.sac.sacpz import attach_paz
    from obspy.signal.invsim import paz_to_freq_resp

    made = case(name)
    (path,) = export(made, "sacpz", tmp_path)
    trace = obspy.Trace()
    with path.open() as stream:
        attach_paz(trace, stream)
    paz = trace.stats.paz
    rate = 2 * read_sensor(made).band_hz[1]
    h, f = paz_to_freq_resp(paz.poles, paz.zeros, paz.gain, 1 / rate, 512, freq=True)
    inside = f >= read_sensor(made).band_hz[0]
    wanted = model_response(made, f[inside], "displacement")
    # ObsPy writes seven digits: 5e-7 over the damping ratio at a resonance.
    np.testing.assert_allclose(h[inside], wanted, rtol=1e-4)


def test_sacpz_and_stationxml_say_what_they_cannot_hold(tmp_path):
    for form in ("sacpz", "stationxml"):
        (path,) = export(case("mems"), form, tmp_path)
        text = path.read_text()
        assert "Pade" in text
        assert "correlation" in text
    assert "holds no uncertainties" in (tmp_path / "sensor.sacpz").read_text()


def test_a_negative_delay_that_is_zero_within_its_uncertainty_is_left_out(tmp_path):
    """Half of all sensors without a delay are given a negative one."""
    values = {**PAPER, "delay": -1e-9}
    with pytest.raises(InputError, match="ahead of the reference"):
        read_sensor(result("accelerometer+delay", values, relative=0.4)).identified.to_scipy()
    made = result("accelerometer+delay", values, relative=0.6)
    system, words = approximate(read_sensor(made))
    f = read_sensor(made).band
    np.testing.assert_allclose(system.response(f), model_response(case("paper"), f), rtol=1e-12)
    stated = float(words[1].rpartition(" ")[2])
    assert stated == pytest.approx(2e-9 * np.pi * f[-1], rel=0.05)
    assert "delay of -1e-09 s, which is zero within its U" in words[0]
    assert len(made.to_sensor().to_scipy().poles) == 2


def test_a_delay_left_out_is_named_with_its_cost(tmp_path):
    made = case("very late")
    (path,) = export(made, "sacpz", tmp_path, without=["delay"])
    line = next(line for line in path.read_text().splitlines() if "deviates from the model" in line)
    stated = float(line.split("up to")[1].split()[0])
    f = read_sensor(made).band
    assert stated == pytest.approx(np.max(np.abs(np.exp(2j * np.pi * f * 4.3e-4) - 1)), rel=0.01)
    assert "left out on request: delay" in path.read_text()


def test_what_would_be_wrong_is_refused(tmp_path):
    drive = result("accelerometer", PAPER, quantity="drive", unit="A")
    for form in ("stationxml", "sacpz"):
        with pytest.raises(InputError, match="drive"):
            export(drive, form, tmp_path)
    with pytest.raises(InputError, match="ahead of the reference"):
        export(result("accelerometer+delay", {**PAPER, "delay": -1e-5}), "stationxml", tmp_path)
    with pytest.raises(InputError, match="too long"):
        export(result("accelerometer+delay", {**PAPER, "delay": 0.1}), "stationxml", tmp_path)
    with pytest.raises(InputError, match="did you mean 'stationxml'"):
        export(paper(), "stationXml", tmp_path)
    with pytest.raises(InputError, match="cannot be left out"):
        export(paper(), "csv", tmp_path, without=["mode2"])
    with pytest.raises(InputError, match="codes cannot be read"):
        export(paper(), "sacpz", tmp_path, channel="nonsense")
    with pytest.raises(InputError, match="lacks parameters"):
        export(replace(paper(), parameters={}), "csv", tmp_path)
    assert not list(tmp_path.iterdir())

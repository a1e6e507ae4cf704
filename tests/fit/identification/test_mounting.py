"""A sensor on its mounting: fitted, or known and taken out of the data, with an uncertainty that covers the truth."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.mounted import COUPLING, LOW_HZ, SENSOR, table

import vibrident
from vibrident.base.errors import InputError, ModelError
from vibrident.data.known import Mounting
from vibrident.physics.models import parse

FITTED = SENSOR | COUPLING
MASS_RATIO, U_MASS_RATIO = 0.2, 0.02
KNOWN = Mounting(30e3, 0.01, 0.03, 0.005, MASS_RATIO, U_MASS_RATIO, 45e3, 0.02)


def fitted(draw):
    """Three masses, the ratio of two of them known exactly."""
    model = f"accelerometer+mounting:{MASS_RATIO}"
    return table(draw, model, FITTED), FITTED


def fitted_with_a_stated_ratio(draw):
    """Three masses; the ratio drawn as its u says."""
    ratio = float(MASS_RATIO + U_MASS_RATIO * np.random.default_rng([draw, 1]).standard_normal())
    mounting = Mounting(mass_ratio=MASS_RATIO, mass_ratio_uncertainty=U_MASS_RATIO)
    made = table(draw, f"accelerometer+mounting:{ratio!r}", FITTED)
    return replace(made, model="accelerometer+mounting", mounting=mounting), FITTED


def known(draw):
    """Three masses below both resonances; frequency, damping and ratio of the mounting drawn as their u say."""
    a, b, c = np.random.default_rng([draw, 2]).standard_normal(3)
    ratio = float(MASS_RATIO + U_MASS_RATIO * c)
    truth = SENSOR | {"mounting_frequency": 30e3 * (1 + 0.01 * a), "mounting_damping": 0.03 + 0.005 * b}
    made = table(draw, f"accelerometer+mounting:{ratio!r}", truth, LOW_HZ)
    return replace(made, model="accelerometer", mounting=KNOWN), SENSOR


CASES = [fitted, fitted_with_a_stated_ratio, known]


def covered(case, draws):
    """The part of draws whose intervals hold the truth, by parameter."""
    inside = []
    for draw in range(draws):
        calibration, truth = case(draw)
        found = vibrident.identify(calibration, estimator="ml").parameters
        ends = {name: found[name].interval_95 for name in truth}
        inside.append([low <= truth[name] <= high for name, (low, high) in ends.items()])
    return np.mean(inside, axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_intervals_cover_the_truth_in_95_of_100_of_500_draws(case):
    assert np.all(np.abs(covered(case, 500) - 0.95) < 0.02)


@pytest.mark.parametrize("case", CASES)
def test_intervals_cover_the_truth_about_as_often_in_five(case):
    assert np.all(covered(case, 5) > 0.55)


@pytest.mark.parametrize("kind", ["random", "sine"])
def test_a_known_mounting_is_taken_out_of_records(kind):
    """The records of a sensor on a mounting give the sensor itself, by the network and by the curve."""
    made = vibrident.simulate(
        ("accelerometer+mounting", FITTED), kind,
        frequencies_hz=[1e3, 5e3, 10e3, 20e3] if kind == "sine" else [1e3, 40e3],
        sampling_rate_hz=204800.0, samples=8000, amplitude=50.0, response_noise=1e-3,
        start="steady" if kind == "sine" else "rest",
    )  # fmt: skip
    result = vibrident.identify(replace(made, model="accelerometer", mounting=Mounting(30e3, 0.0, 0.03)))
    assert result.fit.adequate
    for name, true in SENSOR.items():
        assert result.parameters[name].value == pytest.approx(
            true, abs=5 * result.parameters[name].standard_uncertainty
        )
    assert result.settings["known_responses"][0]["source"] == "mounting at 30000 Hz"
    # As mounted, with what was fitted.
    again = vibrident.identify(made, "accelerometer+mounting", "ipnn")
    assert again.parameters["mounting_frequency"].value == pytest.approx(30e3, rel=1e-3)


def test_what_is_unsure_of_a_known_mounting_grows_with_the_square_of_frequency():
    """Its part of u(S): 2 u(fm)/fm (f/fm)²/(1 − (f/fm)²), in the points' budget; nothing matters below 1 kHz."""
    truth = SENSOR | {"mounting_frequency": 30e3, "mounting_damping": 0.0}
    made = table(1, "accelerometer+mounting", truth, np.geomspace(500.0, 20e3, 17))
    result = vibrident.identify(replace(made, model="accelerometer", mounting=Mounting(30e3, 0.02)))
    budget = result.settings["point_budget"]
    frequency = np.array(budget["frequency_hz"])
    (source,) = [each for each in budget["sources"] if each["source"].startswith("mounting")]
    ratio = (frequency / 30e3) ** 2
    relative = np.array(source["magnitude"]) / np.abs(result.measured.magnitude)
    np.testing.assert_allclose(relative, 0.04 * ratio / (1 - ratio), rtol=0.02)
    (row,) = [row for row in result.settings["uncertainty_budget"] if row["kind"] == "mounting"]
    assert row["standard_uncertainty"] == 0.02
    fixed = parse("accelerometer").frequency_response(SENSOR, result.response.frequency_hz)
    off = np.abs(result.response.magnitude / np.abs(fixed) - 1)
    assert np.all(off < 4 * result.response.magnitude_uncertainty / result.response.magnitude)


def test_a_result_reads_back_with_its_mass_ratio(tmp_path):
    result = vibrident.identify(fitted(1)[0])
    path = tmp_path / "result.json"
    result.save(path)
    sensor = vibrident.Result.load(path).to_sensor()
    assert sensor.model.name == f"accelerometer+mounting:{MASS_RATIO}"
    np.testing.assert_allclose(
        np.abs(sensor.frequency_response(result.response.frequency_hz)), result.response.magnitude, rtol=1e-12
    )
    assert abs(sensor.to_scipy().poles).size == 4
    (file,) = vibrident.export(result, "c", tmp_path / "c", rate_hz=500e3)[:1]
    assert "mounting" in "".join(each.read_text() for each in (tmp_path / "c").glob("*.[ch]"))
    assert file


@pytest.mark.parametrize(
    ("model", "mounting", "says"),
    [
        ("accelerometer+mounting", KNOWN, "both known and fitted"),
        ("accelerometer", Mounting(mass_ratio=0.2), "neither known nor fitted"),
    ],
)
def test_a_mounting_is_known_or_fitted(model, mounting, says):
    with pytest.raises(ModelError, match=says):
        vibrident.identify(replace(fitted(1)[0], model=model, mounting=mounting))


@pytest.mark.parametrize(
    ("stated", "says"),
    [
        ({}, "Nothing is stated"),
        ({"frequency_hz": -1.0}, "cannot be used"),
        ({"frequency_hz": 3e4, "damping_ratio": float("nan")}, "cannot be used"),
        ({"frequency_hz": 3e4, "mass_ratio": 0.2}, "needs the sensor's own resonance"),
    ],
)
def test_what_is_no_mounting_is_refused(stated, says):
    with pytest.raises(InputError, match=says):
        Mounting(**stated)

"""Poles have no names in the response: one rule gives them, to every estimate alike, with the covariance."""

import dataclasses

import numpy as np
import pytest

import vibrident
from vibrident import LeastSquares, MaximumLikelihood
from vibrident.data.records import Calibration, ResponseTable
from vibrident.fit.estimators.canonical import canonically_labelled
from vibrident.fit.problem import Evidence
from vibrident.physics.models import parse
from vibrident.physics.models.labels import canonical, relabellings, rule, slopes

F = np.geomspace(1.0, 8000.0, 40)
TWO_MODES = {
    "sensitivity": -0.1, "natural_frequency": 800.0, "damping_ratio": 0.1, "mode2_frequency": 2500.0,
    "mode2_damping": 0.02, "mode2_gain": 0.3,
}  # fmt: skip
OVERDAMPED = {"natural_frequency": 300.0, "damping_ratio": 3.0, "highpass_frequency": 3.0}
SENSORS = [
    ("accelerometer+mode2+highpass+delay", TWO_MODES | {"highpass_frequency": 2.0, "delay": 1e-4}),
    ("accelerometer+highpass", {"sensitivity": 0.1, **OVERDAMPED}),
    ("velocity-pickup+highpass+delay", {"generator_constant": 20.0, **OVERDAMPED, "delay": 1e-4}),
]


def changed(values, change):
    return {name: float(value) for name, value in change(values).items()}


@pytest.mark.parametrize(("name", "truth"), SENSORS)
def test_every_labelling_has_the_same_response_and_the_same_one_form(name, truth):
    model = parse(name)
    names = [truth, *(changed(truth, one) for one in relabellings(model, truth))]
    assert len(names) == (2 if "mode2_gain" in truth else 3)
    for quantity in ("acceleration", "velocity"):
        h = model.frequency_response(truth, F, quantity)
        for values in names:
            np.testing.assert_allclose(model.frequency_response(values, F, quantity), h, rtol=1e-12)
    for values in names:
        assert canonical(model, values) == pytest.approx(truth, rel=1e-12)


def test_a_pole_far_below_its_natural_frequency_is_not_lost():
    """Of a damping ratio of 9e7 the difference of two numbers left zero, and the high-pass got no frequency."""
    values = {"sensitivity": 2e-4, "natural_frequency": 6e7, "damping_ratio": 9e7, "highpass_frequency": 5e-3}
    model = parse("accelerometer+highpass")
    for one in relabellings(model, values):
        found = changed(values, one)
        assert all(np.isfinite(list(found.values())))
        h = [model.frequency_response(these, F, "acceleration") for these in (values, found)]
        np.testing.assert_allclose(*h, rtol=1e-12)


@pytest.mark.parametrize(("name", "truth"), SENSORS)
def test_the_derivative_of_a_relabelling_is_that_of_differences(name, truth):
    model = parse(name)
    for change in relabellings(model, truth):
        found = slopes(model, change, truth)
        for column, key in enumerate(model.parameter_names):
            step = 1e-6 * abs(truth[key])
            ahead, behind = (changed(truth | {key: truth[key] + s}, change) for s in (step, -step))
            expected = [(ahead[row] - behind[row]) / (2 * step) for row in model.parameter_names]
            np.testing.assert_allclose(found[:, column], expected, rtol=1e-6, atol=1e-9 * np.max(np.abs(expected)))


def table(name, truth, noise=1e-3):
    rng = np.random.default_rng(4)
    h = parse(name).frequency_response(truth, F)
    h = h * (1 + noise * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size)))
    return Calibration(
        table=ResponseTable(F, np.abs(h), np.angle(h), noise * np.abs(h), np.full(F.size, noise)), model=name
    )


@pytest.mark.parametrize("estimator", [MaximumLikelihood(), LeastSquares()])
@pytest.mark.parametrize(("name", "truth"), [("accelerometer+mode2", TWO_MODES), SENSORS[1]])
def test_wherever_a_fit_ends_value_and_uncertainty_are_the_same(estimator, name, truth):
    """From each labelling the optimum is another point; the estimate and its covariance in the one form are one."""
    model = parse(name)
    evidence = Evidence.gather(table(name, truth), model)
    found, moved = [], 0
    for start in (truth, *(changed(truth, one) for one in relabellings(model, truth))):
        raw = estimator.fit(dataclasses.replace(evidence, start=start))
        moved += rule(model, raw.coordinates.values(raw.z)) is not None
        one = canonically_labelled(raw)
        covariance = one.covariance * np.outer(*2 * (one.coordinates.slopes(one.z),))
        found.append((one.coordinates.values(one.z), covariance))
    assert moved >= 1
    for values, covariance in found:
        u = np.sqrt(np.diag(covariance))
        for row, key in enumerate(model.parameter_names):
            assert abs(values[key] - truth[key]) < 4.0 * u[row]
            assert abs(values[key] - found[0][0][key]) < 1e-3 * u[row]
        np.testing.assert_allclose(covariance, found[0][1], rtol=1e-3, atol=1e-6 * np.outer(u, u).max())


def test_what_the_response_does_not_tell_is_named():
    """Three real poles: the rule's choice, and the two other sensors with its response; two modes: a label only."""
    name, truth = SENSORS[1]
    result = vibrident.identify(table(name, truth))
    assert result.warning_codes == ("weakly_determined",)
    assert "three real poles" in result.warnings[0].message
    assert result.parameters["highpass_frequency"].value == pytest.approx(3.0, rel=0.01)
    assert vibrident.identify(table("accelerometer+mode2", TWO_MODES)).warning_codes == ("polarity",)
    equal = vibrident.identify(table("accelerometer+mode2", TWO_MODES | {"mode2_gain": 1.0}, noise=0.01))
    assert "which mode is the main one" in " ".join(w.message for w in equal.warnings)

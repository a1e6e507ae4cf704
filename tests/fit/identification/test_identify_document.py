"""What the result document says beside the parameters, and what the main path refuses."""

import dataclasses

import numpy as np
import pytest

import vibrident
from vibrident.base.errors import ModelError
from vibrident.data.records import Calibration, ResponseTable
from vibrident.fit.estimators import Ipnn
from vibrident.paper.optimiser import Adam
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate
from vibrident.result import Result

P = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}
SHAPE = {"sampling_rate_hz": 10e3, "samples": 2000, "start": "steady"}


@pytest.fixture(scope="module")
def calibration():
    return simulate(
        ("accelerometer", P), frequencies_hz=[63.1, 251.0, 631.0, 1010.0], response_noise=0.01, seed=4, **SHAPE
    )


@pytest.fixture(scope="module")
def results(calibration):
    return {name: vibrident.identify(calibration, estimator=name) for name in ("ml", "ipnn", "lsm")}


@pytest.mark.parametrize("name", ["ml", "ipnn", "lsm"])
def test_the_metrics_fit_together(results, calibration, name):
    """mse = rmse², r2 = 1 − 1/rpd² = 1 − nrmse², mae ≤ rmse; the residual is the noise that was put in, within 3 %."""
    fit = results[name].fit
    assert fit.mse == pytest.approx(fit.rmse**2, rel=1e-12)
    assert fit.r2 == pytest.approx(1 - fit.nrmse**2, rel=1e-12)
    assert fit.rpd * fit.nrmse == pytest.approx(1.0, rel=1e-12)
    assert fit.mae / fit.rmse == pytest.approx(np.sqrt(2 / np.pi), rel=0.15)  # a mixture of Gaussians
    noise = 0.01 * np.sqrt(np.mean([np.var(r.response) for r in calibration.records]))
    assert fit.rmse == pytest.approx(noise, rel=0.03)


def test_the_curve_is_the_models_at_the_parameters_found(results):
    result = results["ml"]
    values = {name: result.parameters[name].value for name in P}
    curve = result.response
    h = parse("accelerometer").frequency_response(values, np.array(curve.frequency_hz))
    np.testing.assert_allclose(curve.magnitude, np.abs(h), rtol=1e-9)
    np.testing.assert_allclose(curve.phase_deg, np.rad2deg(np.angle(h)), atol=1e-7)
    assert (curve.frequency_hz[0], curve.frequency_hz[-1]) == pytest.approx((63.1, 1010.0), rel=1e-3)
    assert np.all(np.diff(curve.phase_deg) < 0)  # it lags more and more


def test_the_measured_points_are_the_tones(results):
    """Four tones in order, within five of their uncertainties of the truth; deviations in per cent."""
    result = results["ml"]
    measured = result.measured
    assert measured.frequency_hz == pytest.approx((63.1, 251.0, 631.0, 1010.0), rel=1e-4)
    true = parse("accelerometer").frequency_response(P, np.array(measured.frequency_hz))
    np.testing.assert_array_less(
        np.abs(measured.magnitude - np.abs(true)), 5 * np.array(measured.magnitude_uncertainty)
    )
    values = {name: result.parameters[name].value for name in P}
    model = np.abs(parse("accelerometer").frequency_response(values, np.array(measured.frequency_hz)))
    np.testing.assert_allclose(measured.deviation_percent, 100 * (model / measured.magnitude - 1), atol=1e-9)
    assert len(set(measured.record)) == 4


def test_the_document_round_trips_through_a_file(results, tmp_path):
    for name, result in results.items():
        path = result.save(tmp_path / f"{name}.json")
        assert Result.load(path).to_dict() == result.to_dict()


def test_the_network_shows_its_weights(results):
    """W1…W4 of the band-limited step at 10 kHz: four terms or more an input; W3's eigenvalues are e^{λ Ts}."""
    weights = results["ipnn"].weights
    assert {"W1", "W2", "W3", "W4"} <= weights.keys()
    assert weights["sampling_interval_s"] == 1e-4
    p = {name: results["ipnn"].parameters[name].value for name in P}
    wn = 2 * np.pi * p["natural_frequency"]
    pole = wn * (-p["damping_ratio"] + 1j * np.sqrt(1 - p["damping_ratio"] ** 2))
    found = np.linalg.eigvals(np.array(weights["W3"]["value"]))
    expected = np.exp(1e-4 * np.array([pole, np.conj(pole)]))
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), rtol=1e-9)
    assert results["ml"].weights == {}


def test_the_references_uncertainty_is_part_of_the_gains(calibration, results):
    """0.5 % of the reference: u(S0) grows to the root of the sum of squares, the others stay."""
    stated = vibrident.identify(dataclasses.replace(calibration, reference_standard_uncertainty=0.005))
    for name in P:
        one, other = results["ml"].parameters[name], stated.parameters[name]
        assert other.value == one.value
        extra = 0.005 * one.value if name == "sensitivity" else 0.0
        assert other.standard_uncertainty == pytest.approx(np.hypot(one.standard_uncertainty, extra), rel=1e-9)
    assert stated.parameters["conversion_coefficient"].standard_uncertainty > (
        0.005 * stated.parameters["conversion_coefficient"].value
    )


def test_progress_is_told(calibration):
    heard = []
    vibrident.identify(calibration, estimator="ipnn", progress=lambda i, most, cost: heard.append((i, most, cost)))
    assert heard[0][0] == 1
    assert all(i <= most and np.isfinite(cost) for i, most, cost in heard)
    trace = vibrident.identify(calibration, estimator="ipnn").training
    assert trace.status == "converged"
    assert trace.loss[-1] == pytest.approx(1.0, rel=0.1)  # a sum of squares in units of the noise, over its count
    assert trace.parameters["natural_frequency"][-1] == pytest.approx(652.0, rel=0.01)


def a_table():
    f = np.geomspace(10.0, 1000.0, 12)
    h = parse("accelerometer").frequency_response(P, f)
    return Calibration(table=ResponseTable(f, np.abs(h), np.angle(h), 1e-3 * np.abs(h), np.full(12, 1e-3)))


REFUSED = [
    (lambda: simulate(("accelerometer", P), "random", **SHAPE), "ml", "sine records"),
    (lambda: simulate(("accelerometer", P), "random", **SHAPE), "lsm", "complex responses"),
    (lambda: simulate(("accelerometer", P), "decay", **SHAPE), "ipnn", "with a reference"),
    (a_table, "ipnn", "with a reference"),
    (a_table, "lmt", "not known"),
    (a_table, "ml", None),
]


@pytest.mark.parametrize(("made", "estimator", "problem"), REFUSED)
def test_what_does_not_fit_together_is_refused(made, estimator, problem):
    if problem is None:
        assert vibrident.identify(made(), estimator=estimator).fit.adequate
        return
    with pytest.raises(ModelError) as caught:
        vibrident.identify(made(), estimator=estimator)
    assert problem in caught.value.problem
    assert all((caught.value.expected, caught.value.found, caught.value.where, caught.value.remedy))


def test_the_sampling_rate_does_not_matter():
    """The same motion sampled at 4, 10 and 51.2 kHz without noise: one sensor, to 2e-6."""
    found = []
    for rate in (4000.0, 20000.0):
        calibration = simulate(
            ("accelerometer", P), "multisine", frequencies_hz=np.geomspace(20, 1200, 15), sampling_rate_hz=rate,
            samples=round(0.4 * rate), seed=5,
        )  # fmt: skip
        found.append([vibrident.identify(calibration).parameters[name].value for name in P])
    np.testing.assert_allclose(found, np.tile(list(P.values()), (2, 1)), rtol=2e-6)


@pytest.mark.slow
def test_the_papers_optimiser_comes_to_the_same_sensor(calibration):
    """A trapezoidal network by Adam, 600 steps, and by Levenberg–Marquardt: within 10⁻³ of each other."""
    slow = vibrident.identify(
        calibration, estimator=Ipnn(discretisation="tustin", optimiser=Adam(learning_rate=0.005, steps=600))
    )
    fast = vibrident.identify(calibration, estimator=Ipnn(discretisation="tustin"))
    for name in P:
        assert slow.parameters[name].value == pytest.approx(fast.parameters[name].value, rel=1e-3)
    assert slow.training.optimiser == "adam"

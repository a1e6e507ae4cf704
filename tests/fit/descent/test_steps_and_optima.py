"""The ways down the residual lead to one optimum; where estimators have to differ, and where not."""

from __future__ import annotations

import numpy as np
import pytest

import vibrident
from vibrident import Ipnn, LeastSquares, MaximumLikelihood
from vibrident.base.backend import jnp
from vibrident.data.records import Calibration
from vibrident.fit.optimise import levenberg_marquardt
from vibrident.fit.problem import Coordinates, Evidence, Local
from vibrident.fit.problem.time_domain import TimeProblem, evaluate
from vibrident.paper.adam import adam
from vibrident.paper.free_weights import FreeIpnn
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import SENSORS, simulate

PAPER = dict(SENSORS["paper"].parameters)
MODEL = parse("accelerometer")
START = {"sensitivity": 0.1, "natural_frequency": 640.0, "damping_ratio": 0.21}


def _in_time(z, args):
    return evaluate(jnp.asarray(z), *args)


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return simulate(
        "paper", "sine", frequencies_hz=[100, 400, 630, 1000], samples=600, response_noise=0.01, start="rest", seed=1
    )


@pytest.fixture(scope="module")
def problem(calibration: Calibration) -> TimeProblem:
    return TimeProblem.build(calibration.records, MODEL, method("bandlimited"), "acceleration", START)


def arguments(problem: TimeProblem) -> tuple:
    coordinates = Coordinates.at(MODEL, START, (100.0, 1000.0))
    noise = jnp.asarray(problem.by_lane(np.full(len(problem.records), 0.01)))
    return coordinates, problem.layout, problem.data, noise


def test_a_parameter_without_influence_is_left_where_it_is() -> None:
    """Also where its row of JᵀJ is zero, or a little below by rounding, and however small the damping has become."""
    rows = np.array([[1.0, 0.5], [0.2, 2.0], [1.5, -1.0]])

    def objective(z: np.ndarray, args: float) -> Local:
        residual = np.array([1.0, 2.0, 3.0]) - rows @ np.sinh(z[:2])
        jacobian = rows * np.cosh(z[:2])
        matrix, gradient = np.diag([0.0, 0.0, args]), np.zeros(3)
        matrix[:2, :2], gradient[:2] = jacobian.T @ jacobian, jacobian.T @ residual
        return Local(matrix, gradient, residual @ residual)

    for diagonal in (0.0, -1e-18):
        trace = levenberg_marquardt(objective, np.array([0.1, -0.2, 0.7]), diagonal, tolerance=1e-25)
        assert trace.converged
        assert trace.last[2] == 0.7
        np.testing.assert_allclose(
            np.sinh(trace.last[:2]), np.linalg.lstsq(rows, [1.0, 2.0, 3.0], rcond=None)[0], rtol=1e-9
        )


@pytest.mark.parametrize("bent", [0.5, 0.9, 0.95])
def test_beside_a_large_residual_the_optimum_is_reached(bent: float) -> None:
    """Residuals x + 1 and bent x² + x − 1, the optimum at zero (after Dennis & Schnabel 1983, ch. 10).

    Gauss–Newton steps alone leave the part ``bent`` of the way each.
    """
    evaluations = 0

    def objective(z: np.ndarray, _: None) -> Local:
        nonlocal evaluations
        evaluations += 1
        residual = np.array([z[0] + 1.0, bent * z[0] ** 2 + z[0] - 1.0])
        slope = np.array([[1.0], [2.0 * bent * z[0] + 1.0]])
        return Local(slope.T @ slope, -slope.T @ residual, residual @ residual)

    trace = levenberg_marquardt(objective, np.array([1.0]), None, tolerance=1e-12)
    assert trace.converged
    assert trace.costs[-1] - 2.0 < 1e-6
    assert evaluations < 15


def test_of_an_overdamped_sensor_the_way_is_short() -> None:
    """Of a low-pass of first order the data show sensitivity and f0/δ alone: along the rest nothing is gained."""
    lowpass = {"sensitivity": 0.1, "natural_frequency": 60e3, "damping_ratio": 100.0}
    made = simulate(
        ("accelerometer", lowpass), "random", frequencies_hz=(20.0, 2000.0), samples=4000, sampling_rate_hz=1e4,
        response_noise=1e-3, seed=1,
    )  # fmt: skip
    result = vibrident.identify(made, estimator=Ipnn())
    gain = result.parameters["sensitivity"]
    assert abs(gain.value - 0.1) < 4.0 * (gain.standard_uncertainty or 0.0)
    assert result.training.iterations < 15


def test_adam_reaches_the_optimum_of_levenberg_marquardt(problem: TimeProblem) -> None:
    args = arguments(problem)
    best = levenberg_marquardt(_in_time, args[0].first, args)
    slow = adam(_in_time, args[0].first, args, learning_rate=0.003, steps=800)
    u = np.sqrt(np.diag(np.linalg.inv(np.asarray(evaluate(jnp.asarray(best.last), *args).matrix))))
    assert best.converged
    assert np.max(np.abs(slow.last - best.last) / u) < 0.05


def test_plain_least_squares_is_the_linear_fit_of_the_paper() -> None:
    """1/H is linear in 1/K, 2 δ ωn/K and ωn²/K: NumPy's lstsq finds the same sensor."""
    rng = np.random.default_rng(1)
    frequency = 10.0 ** (np.arange(10, 31) / 10)
    clean = MODEL.frequency_response(PAPER, frequency)
    noisy = clean * (1 + 0.002 * (rng.standard_normal(21) + 1j * rng.standard_normal(21)))
    table = vibrident.ResponseTable(
        frequency, np.abs(noisy), np.angle(noisy), 0.002 * np.abs(noisy), np.full(21, 0.002)
    )
    evidence = Evidence.gather(Calibration(table=table), MODEL)
    estimate = LeastSquares(weighting="plain").fit(evidence)
    found = estimate.coordinates.values(estimate.z)

    w = 2 * np.pi * frequency
    design = np.stack([-(w**2), 1j * w, np.ones(21)], axis=1)
    scale = np.array([1e6, 1e3, 1.0])
    real = np.concatenate([design.real, design.imag]) / scale
    a, b, c = np.linalg.lstsq(real, np.concatenate([(1 / noisy).real, (1 / noisy).imag]), rcond=None)[0] / scale
    assert found["sensitivity"] == pytest.approx(1 / c, rel=1e-7)
    assert found["natural_frequency"] == pytest.approx(np.sqrt(c / a) / (2 * np.pi), rel=1e-7)
    assert found["damping_ratio"] == pytest.approx(b / (2 * np.sqrt(a * c)), rel=1e-6)


@pytest.mark.parametrize("discretisation", ["bandlimited", "foh"])
@pytest.mark.quick("foh")
def test_free_weights_find_the_sensor(discretisation: str) -> None:
    calibration = simulate("paper", "sine", response_noise=0.01, samples=3000, seed=2)
    free = vibrident.identify(calibration, estimator=FreeIpnn(discretisation=discretisation))
    for name, value in PAPER.items():
        parameter = free.parameters[name]
        assert abs(parameter.value - value) < 4 * (parameter.standard_uncertainty or 0.0)
    assert free.settings["weights"] == "free"


@pytest.mark.slow
def test_a_model_error_joins_where_the_model_is_wrong_and_only_there() -> None:
    second = {**PAPER, "mode2_frequency": 300.0, "mode2_damping": 0.1, "mode2_gain": 0.02}
    frequencies = 10.0 ** (np.arange(12, 31, 2) / 10)
    wrong = simulate(
        ("accelerometer+mode2", second),
        "sine",
        frequencies_hz=frequencies,
        sampling_rate_hz=51200.0,
        samples=2000,
        amplitude=9.8,
        response_noise=1e-3,
        seed=1,
    )
    result = vibrident.identify(wrong, model="accelerometer")
    assert 1e-3 < result.settings["model_error"] < 0.05
    alone = vibrident.identify(wrong, model="accelerometer", uncertainty="noise")
    assert "model_error" not in alone.settings
    for name in PAPER:
        wide, narrow = (r.parameters[name].standard_uncertainty or 0.0 for r in (result, alone))
        assert wide > 10 * narrow
    right = vibrident.identify(
        simulate("paper", "sine", frequencies_hz=frequencies, response_noise=0.01, samples=2000, seed=1)
    )
    assert "model_error" not in right.settings


def test_maximum_likelihood_is_not_biased_by_noise_on_the_reference() -> None:
    """20 dB of noise that the sensor does not feel: the output-error fit is off by −0.06 % in S0, this one is not."""
    calibration = simulate("paper", "sine", response_noise=0.01, reference_noise=0.1, seed=3)
    result = vibrident.identify(calibration, estimator=MaximumLikelihood())
    sensitivity = result.parameters["sensitivity"]
    assert abs(sensitivity.value - PAPER["sensitivity"]) < 3.5 * (sensitivity.standard_uncertainty or 0.0)
    assert (sensitivity.standard_uncertainty or 1.0) < 4e-4 * PAPER["sensitivity"]

"""The lines against the network unrolled in time: the same samples and weights, the same least-squares problem."""

from dataclasses import replace

import numpy as np
import pytest

from vibrident.backend import jnp
from vibrident.discretize import method
from vibrident.estimators.objectives import time_objective
from vibrident.estimators.optimise import levenberg_marquardt
from vibrident.models import parse
from vibrident.problem import Coordinates, TimeProblem
from vibrident.problem.line_problem import line_objective
from vibrident.problem.time_domain import evaluate
from vibrident.simulation import simulate, with_noise

RATE, SAMPLES = 10e3, 1503
SENSORS = {
    "accelerometer": {"sensitivity": 0.104, "natural_frequency": 352.0, "damping_ratio": 0.182},
    "velocity-pickup": {"generator_constant": 28.0, "natural_frequency": 45.0, "damping_ratio": 0.56},
}
ADDED = {
    "delay": {"delay": 137e-6},
    "highpass": {"highpass_frequency": 12.0},
    "mode2": {"mode2_frequency": 1800.0, "mode2_damping": 0.03, "mode2_gain": 0.04},
}


@pytest.fixture(autouse=True)
def every_line_counts(monkeypatch):
    """As every sample does in time; otherwise lines near half the sampling rate are left out."""
    monkeypatch.setattr("vibrident.problem.line_problem.USABLE_BAND", 0.5)


def values_of(model):
    core, *add_ons = model.split("+")
    return {**SENSORS[core], **{name: v for addon in add_ons for name, v in ADDED[addon].items()}}


def random_motion(model, samples=SAMPLES, rate=RATE):
    true = (model, values_of(model))
    made = simulate(true, "random", frequencies_hz=[20.0, 2000.0], sampling_rate_hz=rate, samples=samples, seed=5)
    return with_noise(made, response_noise=0.02, seed=6).records[0]


def a_problem(records, model, quantity, name, rng):
    """The problem away from its optimum, coordinates, and a noise of each record."""
    start = {key: value * rng.uniform(0.9, 1.1) for key, value in values_of(model).items()}
    problem = TimeProblem.build(records, parse(model), method(name), quantity, start)
    return problem, Coordinates.at(parse(model), start, (20.0, 2000.0)), 0.03 * np.arange(1.0, len(records) + 1.0)


def assert_the_same(problem, coordinates, noise):
    """Cost, Jᵀr and JᵀJ within 1e-9."""
    z = coordinates.first
    args = (coordinates, problem.layout, problem.data, jnp.asarray(problem.by_lane(noise)))
    whole, lines = evaluate(jnp.asarray(z), *args), problem.at_lines.normal(z, coordinates, noise)
    scale, size = np.sqrt(np.diag(lines.matrix)), np.sqrt(lines.cost)
    assert lines.cost == pytest.approx(float(whole.cost), rel=1e-9)
    both = np.outer(scale, scale)
    np.testing.assert_allclose(np.asarray(whole.matrix) / both, lines.matrix / both, atol=1e-9)
    np.testing.assert_allclose(np.asarray(whole.gradient) / scale / size, lines.gradient / scale / size, atol=1e-9)


@pytest.mark.parametrize("quantity", ["acceleration", "velocity", "displacement"])
@pytest.mark.parametrize("core", ["accelerometer", "velocity-pickup"])
def test_every_reference_quantity(core, quantity, rng):
    assert_the_same(*a_problem([random_motion(core)], core, quantity, "bandlimited", rng))


@pytest.mark.parametrize("name", ["euler", "zoh", "foh", "tustin"])
def test_every_discretisation(name, rng):
    model = "accelerometer+delay"
    assert_the_same(*a_problem([random_motion(model)], model, "acceleration", name, rng))


@pytest.mark.parametrize(
    "model",
    ["accelerometer+delay", "velocity-pickup+highpass+delay", "accelerometer+mode2+highpass+delay"],
)
def test_every_add_on(model, rng):
    assert_the_same(*a_problem([random_motion(model)], model, "acceleration", "bandlimited", rng))


def records_of_all_kinds(model):
    """A record with a gap, one at another rate, and a free decay, which has no reference."""
    gap = np.arange(2400) == 1200
    return [
        random_motion(model, 2400).without(gap, "test"),
        random_motion(model, rate=1.6 * RATE),
        replace(random_motion(model), reference=None, excitation="decay"),
    ]


def test_gaps_decays_and_two_rates(rng):
    model = "accelerometer+delay"
    assert_the_same(*a_problem(records_of_all_kinds(model), model, "acceleration", "bandlimited", rng))


def test_the_optimum_and_the_predicted_response(rng):
    """Trained either way: the same parameters to 1e-9 of themselves, and the same response with the best states."""
    model = "accelerometer+delay"
    problem, coordinates, noise = a_problem(records_of_all_kinds(model), model, "acceleration", "bandlimited", rng)
    in_time = (coordinates, problem.layout, problem.data, jnp.asarray(problem.by_lane(noise)))
    one = levenberg_marquardt(time_objective, coordinates.first, in_time, tolerance=1e-15)
    other = levenberg_marquardt(
        line_objective, coordinates.first, (coordinates, problem.at_lines, noise), tolerance=1e-15
    )
    np.testing.assert_allclose(other.last, one.last, rtol=0, atol=1e-8)
    response = problem.by_record(evaluate(jnp.asarray(one.last), *in_time).response)
    for record, ours, theirs in zip(problem.records, problem.predict(coordinates, one.last), response, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.max(np.abs(record.response)))

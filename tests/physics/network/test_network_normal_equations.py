"""The accumulated normal equations against automatic and finite differences, and dense algebra in NumPy."""

import numpy as np
import pytest
from tests.support.discrete_sensors import recursion
from tests.support.unrolled import cut, physical_residual, random_weights, stacked, time_residual

from vibrident.base.backend import jax, jnp
from vibrident.fit.descent.settle import Objective
from vibrident.fit.problem import BinProblem, Coordinates
from vibrident.fit.problem.time_domain import TimeProblem, evaluate
from vibrident.physics.discretisation import Weights, method
from vibrident.physics.models import parse
from vibrident.physics.network.sensitivity import normal_equations
from vibrident.physics.simulation import simulate, with_noise

TRUE = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182, "delay": 37e-6}


def a_problem(name="bandlimited", model="accelerometer+delay", way=TimeProblem):
    """Random motion with 2 % noise, a gap, records of two lengths and two rates; away from the optimum."""
    true = {k: v for k, v in TRUE.items() if k != "delay" or "delay" in model}
    records = []
    for rate, samples in ((10e3, 1500), (10e3, 700), (16e3, 900)):
        made = simulate(
            (model, true), "random", frequencies_hz=[20.0, 2000.0], sampling_rate_hz=rate, samples=samples, seed=samples
        )
        records += with_noise(made, response_noise=0.02, seed=samples).records
    bad = np.zeros(1500, dtype=bool)
    bad[600:640] = True
    records[0] = records[0].without(bad, "test")
    start = {k: v * f for (k, v), f in zip(true.items(), (1.05, 0.97, 1.2, 0.9), strict=False)}
    problem = way.build(records, parse(model), method(name), "acceleration", start)
    coordinates = Coordinates.at(parse(model), start, (20.0, 2000.0))
    noise = np.array([0.02, 0.03, 0.05])
    return problem, coordinates, coordinates.first, problem.by_lane(noise) if way is TimeProblem else noise


_jacobian = jax.jit(jax.jacfwd(physical_residual), static_argnames=("layout",))
_residual = jax.jit(physical_residual, static_argnames=("layout",))


@pytest.mark.parametrize("name", ["bandlimited", "euler", "tustin", "foh", "zoh"])
@pytest.mark.slow
def test_against_automatic_differentiation_of_the_residual(name):
    """JᵀJ, Jᵀr and rᵀr within 1e-9 of those of ``jacfwd`` on the dense residual; J = −∂r/∂z."""
    problem, coordinates, z, noise = a_problem(name)
    args = (jnp.asarray(z), coordinates, problem.layout, problem.data, jnp.asarray(noise))
    residual, jacobian = np.asarray(_residual(*args)), -np.asarray(_jacobian(*args))
    normal = evaluate(*args)
    scale = np.sqrt(np.diag(jacobian.T @ jacobian))
    np.testing.assert_allclose(
        np.asarray(normal.matrix) / np.outer(scale, scale), jacobian.T @ jacobian / np.outer(scale, scale), atol=1e-9
    )
    size = np.linalg.norm(residual)
    np.testing.assert_allclose(
        np.asarray(normal.gradient) / scale / size, jacobian.T @ residual / scale / size, atol=1e-10
    )
    assert float(normal.cost) == pytest.approx(residual @ residual, rel=1e-12)
    for number, column in enumerate(normal.columns):
        np.testing.assert_allclose(np.asarray(column).ravel(), jacobian[:, number], atol=1e-9 * scale[number])


@pytest.mark.parametrize("way", [BinProblem, TimeProblem])
def test_against_finite_differences(way):
    """Central differences of the cost: the gradient is exact though the nuisance is held (Kaufman 1975)."""
    problem, coordinates, z, noise = a_problem(way=way)

    def evaluated(point):
        if way is BinProblem:
            return Objective.plain(problem, coordinates, noise**2)(point)
        return evaluate(jnp.asarray(point), coordinates, problem.layout, problem.data, jnp.asarray(noise))

    normal = evaluated(z)
    # In units of the parameters' standard deviations, a step of 1e-3 leaves an error of 1e-7 of the curvature.
    deviation = 1.0 / np.sqrt(np.diag(np.asarray(normal.matrix)))
    for number in range(len(z)):
        step = np.zeros_like(z)
        step[number] = 0.03 * deviation[number]
        slope = float(evaluated(z + step).cost - evaluated(z - step).cost) / (2 * step[number])
        assert slope * deviation[number] == pytest.approx(
            -2 * float(normal.gradient[number]) * deviation[number], rel=2e-5, abs=1e-4
        )


def test_columns_against_finite_differences_and_a_dense_projection():
    """J by central differences of the response with states and offsets held, freed of C Φᵏ and 1 by ``lstsq``."""
    problem, coordinates, z, noise = a_problem()
    layout, lanes = problem.layout, problem.lanes
    normal = evaluate(jnp.asarray(z), coordinates, layout, problem.data, jnp.asarray(noise))
    weights = [np.asarray(w) for w in problem.weights(coordinates.values(z))]
    steps = 1e-5 * np.ones(len(z))
    for owner, run, lane in problem.pieces:
        n = run.stop - run.start
        rate = int(np.asarray(lanes.rate)[lane])
        count = -(-n // lanes.inputs.shape[0])
        inputs = np.concatenate([lanes.inputs[:, :, lane + k] for k in range(count)])[:n]
        series = np.asarray(normal.response).T[lane : lane + count].ravel()[:n]
        here = Weights(*(w[rate] for w in weights))
        basis = np.stack([recursion(here, 0 * inputs, e) for e in np.eye(2)] + [np.ones(n)], axis=1)
        state = np.linalg.lstsq(basis, series - recursion(here, inputs, np.zeros(2)), rcond=None)[0]
        for number in range(len(z)):
            sides = []
            for sign in (-1, 1):
                moved = np.array(z)
                moved[number] += sign * steps[number]
                there = Weights(*(np.asarray(w)[rate] for w in problem.weights(coordinates.values(moved))))
                sides.append(recursion(there, inputs, state[:2], state[2]))
            slope = (sides[1] - sides[0]) / (2 * steps[number])
            used = problem.records[owner].mask[run]
            slope = slope - basis @ np.linalg.lstsq(basis[used], slope[used], rcond=None)[0]
            column = np.asarray(normal.columns[number]).T[lane : lane + count].ravel()[:n] * noise[lane]
            np.testing.assert_allclose(column[used], slope[used], atol=2e-8 * np.max(np.abs(slope)))


@pytest.mark.slow
def test_free_weights_entry_by_entry(rng):
    """All n² + n q + n + q weights free, at two rates: JᵀJ and Jᵀr of ``jacfwd`` on the residual."""
    sets = [random_weights(rng, terms=2) for _ in range(2)]
    segments = []
    for steps, rate in ((300, 0), (70, 1), (150, 1)):
        inputs = rng.standard_normal((steps, 2))
        weight = (rng.uniform(size=steps) > 0.05).astype(float)
        segments.append(
            (inputs, recursion(sets[rate], inputs, [1, -1], 0.3) + rng.standard_normal(steps), weight, rate)
        )
    lanes, _ = cut(segments, 64)
    noise = jnp.asarray(np.array([0.5, 2.0, 1.3])[lanes.segment])  # one level a segment
    given = stacked(sets)
    sizes = [np.size(w) for w in given]
    ends = np.cumsum(sizes)

    def back(vector):
        return Weights(*(vector[e - n : e].reshape(w.shape) for e, n, w in zip(ends, sizes, given, strict=True)))

    flat = jnp.concatenate([jnp.ravel(jnp.asarray(w)) for w in given])
    slopes = jax.jacfwd(back)(flat)
    normal = jax.jit(normal_equations, static_argnums=4)(back(flat), slopes, lanes, noise, 3)
    jacobian = -np.asarray(jax.jit(jax.jacfwd(lambda v: time_residual(back(v), lanes, noise, 3)))(flat))
    residual = np.asarray(time_residual(back(flat), lanes, noise, 3))
    scale = np.max(np.abs(jacobian.T @ jacobian))
    np.testing.assert_allclose(np.asarray(normal.matrix), jacobian.T @ jacobian, atol=1e-11 * scale)
    np.testing.assert_allclose(
        np.asarray(normal.gradient), jacobian.T @ residual, atol=1e-11 * np.sqrt(scale) * np.linalg.norm(residual)
    )
    unweighted = residual.reshape(64, -1) * np.asarray(noise)
    for number in range(3):
        expected = np.sum(unweighted[:, np.asarray(lanes.segment) == number] ** 2)
        assert float(normal.squares[number]) == pytest.approx(expected, rel=1e-10)


@pytest.mark.slow
def test_chunk_length_does_not_matter(monkeypatch):
    """Cost, gradient and JᵀJ of chunks of 32, 100 and 256 steps agree to 1e-11."""
    found = []
    for chunk in (32, 100, 256):
        monkeypatch.setattr("vibrident.fit.problem.time_domain.CHUNK", chunk)
        problem, coordinates, z, noise = a_problem()
        assert problem.lanes.inputs.shape[0] == chunk
        found.append(evaluate(jnp.asarray(z), coordinates, problem.layout, problem.data, jnp.asarray(noise)))
    scale = np.sqrt(np.diag(np.asarray(found[2].matrix)))
    for normal in found[:2]:
        assert float(normal.cost) == pytest.approx(float(found[2].cost), rel=1e-11)
        np.testing.assert_allclose(
            np.asarray(normal.matrix) / np.outer(scale, scale),
            np.asarray(found[2].matrix) / np.outer(scale, scale),
            atol=1e-11,
        )
        np.testing.assert_allclose(
            np.asarray(normal.gradient) / scale, np.asarray(found[2].gradient) / scale, atol=1e-9
        )

"""The network trained by Gauss–Newton is the classical Gauss–Newton, iterate by iterate.

The classical side is dense and in NumPy: the recursion of the discretised sensor sample by sample, its derivatives by
complex steps, initial states and offsets as unknowns beside the parameters.
"""

import numpy as np
import pytest
from scipy.linalg import expm
from tests.support.unrolled import physical_residual

from vibrident.base.backend import jax, jnp
from vibrident.data.records import Record
from vibrident.fit.descent.settle import Objective
from vibrident.fit.optimise import levenberg_marquardt
from vibrident.fit.problem import BinProblem, Coordinates, network_objective
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse

RATE = 8000.0
START = {"sensitivity": 0.12, "natural_frequency": 600.0, "damping_ratio": 0.25}
NOISE = np.array([0.02, 0.05])


def held_step(z):
    """Exact step of eq. (4) for a held input at coordinates z (which may be complex), in V and V̇/ωn."""
    gain, wn, damping = z[0] * 0.12, 2 * np.pi * 600.0 * np.exp(z[1]), np.sinh(z[2])
    block = np.zeros((3, 3), dtype=complex)
    block[:2, :2] = wn / RATE * np.array([[0, 1], [-1, -2 * damping]])
    block[1, 2] = wn / RATE * gain
    whole = expm(block)
    return whole[:2, :2], whole[:2, 2]


def response(z, inputs, state, offset):
    phi, gamma = held_step(z)
    x, outputs = np.array(state, dtype=complex), np.empty(len(inputs), dtype=complex)
    for k, u in enumerate(inputs):
        outputs[k] = x[0] + offset
        x = phi @ x + gamma * u
    return outputs


@pytest.fixture(scope="module")
def records():
    rng = np.random.default_rng(5)
    made = []
    for number, samples in enumerate((420, 300)):
        inputs = rng.standard_normal(samples)
        clean = response([0.9, 0.08, 0.18], inputs, [0.3, -0.2], 0.7 - number).real
        noisy = clean + NOISE[number] * rng.standard_normal(samples)
        made.append(Record(f"record {number}", inputs, noisy, RATE, "random"))
    return made


@pytest.fixture(scope="module", params=[BinProblem, TimeProblem])
def problem(records, request):
    return request.param.build(records, parse("accelerometer"), method("zoh"), "acceleration", START)


@pytest.fixture(scope="module")
def coordinates():
    return Coordinates.at(parse("accelerometer"), START, (20.0, 2000.0))


def objective_of(problem, coordinates):
    """What gives cost, gradient and normal matrix at z, either way."""
    if isinstance(problem, BinProblem):
        return Objective.plain(problem, coordinates, NOISE**2)
    return lambda z, _=None: network_objective(z, (coordinates, problem, NOISE))


def dense(records, z):
    """Weighted residual and Jacobian over (z, x0, offset of each record), at the best x0 and offsets for this z."""
    rows, targets = [], []
    for number, record in enumerate(records):
        inputs = record.reference - record.reference.mean()
        zero = np.zeros_like(inputs)
        free = np.stack([response(z, zero, e, 0.0).real for e in np.eye(2)] + [zero + 1.0], axis=1)
        forced = response(z, inputs, [0, 0], 0.0).real
        nuisance = np.linalg.lstsq(free, record.response - forced, rcond=None)[0]
        slopes = np.stack(
            [response(z + 1e-30j * e, inputs, nuisance[:2], nuisance[2]).imag / 1e-30 for e in np.eye(3)], axis=1
        )
        beside = np.zeros((len(inputs), 3 * len(records)))
        beside[:, 3 * number : 3 * number + 3] = free
        rows.append(np.concatenate([slopes, beside], axis=1) / NOISE[number])
        targets.append((record.response - forced - free @ nuisance) / NOISE[number])
    return np.concatenate(targets), np.concatenate(rows)


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_five_iterates_of_the_classical_method(damping, records, problem, coordinates):
    """z ← z + (JᵀJ + λ diag JᵀJ)⁻¹ Jᵀr over all unknowns, λ on the parameters: the same to 1e-8."""
    unrolled = classical = coordinates.first
    for _ in range(5):
        residual, jacobian = dense(records, classical)
        normal = objective_of(problem, coordinates)(unrolled)
        assert float(normal.cost) == pytest.approx(residual @ residual, rel=1e-10)
        gram = jacobian.T @ jacobian
        projected = gram[:3, :3] - gram[:3, 3:] @ np.linalg.solve(gram[3:, 3:], gram[3:, :3])
        np.testing.assert_allclose(np.asarray(normal.matrix), projected, rtol=1e-7)
        gram[:3, :3] += damping * np.diag(np.diag(projected))
        classical = classical + np.linalg.solve(gram, jacobian.T @ residual)[:3]
        matrix = np.asarray(normal.matrix)
        damped = matrix + damping * np.diag(np.diag(matrix))
        unrolled = unrolled + np.linalg.solve(damped, np.asarray(normal.gradient))
        np.testing.assert_allclose(unrolled, classical, atol=1e-8)
    assert np.max(np.abs(classical - [0.9, 0.08, 0.18])) < (0.02 if damping else 0.005)


def test_levenberg_marquardt_on_normal_equations_takes_the_dense_ones_steps(records, coordinates):
    """Optimistix on all 720 residuals at once, against the package's optimiser on cost, gradient and JᵀJ.

    The same steps, until what was learned of the residual's curvature makes those at the end better.
    """
    import equinox as eqx
    import optimistix as optx

    problem = TimeProblem.build(records, parse("accelerometer"), method("zoh"), "acceleration", START)
    noise = jnp.asarray(problem.by_lane(NOISE))
    trace = levenberg_marquardt(network_objective, coordinates.first, (coordinates, problem, NOISE), tolerance=1e-10)
    assert trace.converged
    solver = optx.LevenbergMarquardt(rtol=1e-12, atol=1e-12)
    solver = eqx.tree_at(lambda solver: solver.search, solver, optx.ClassicalTrustRegion(high_cutoff=0.9))

    def residual(z, args):
        return physical_residual(z, coordinates, problem.layout, problem.data, noise), None

    @eqx.filter_jit
    def step(z, state):
        z, state, _ = solver.step(residual, z, None, {}, state, frozenset())
        return z, state

    z = jnp.asarray(coordinates.first)
    shape = jax.ShapeDtypeStruct(jax.eval_shape(residual, z, None)[0].shape, z.dtype)
    state = solver.init(residual, z, None, {}, shape, None, frozenset())
    path = []
    for _ in range(len(trace.costs) + 6):
        before = state.num_accepted_steps
        z, state = step(z, state)
        if state.num_accepted_steps > before:
            path.append(np.asarray(z))
    assert 5 <= len(trace.coordinates) <= len(path)
    np.testing.assert_allclose(trace.coordinates[:5], path[:5], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(trace.last, path[-1], atol=1e-8)


def test_the_optimum_is_where_the_dense_gradient_vanishes(records, problem, coordinates):
    trace = levenberg_marquardt(objective_of(problem, coordinates), coordinates.first, None, tolerance=1e-12)
    residual, jacobian = dense(records, trace.last)
    scale = np.linalg.norm(jacobian, axis=0) * np.linalg.norm(residual)
    assert np.max(np.abs(jacobian.T @ residual) / scale) < 1e-6
    # 720 samples less 3 parameters and 6 nuisances at their true noise: χ² within four standard deviations.
    assert trace.costs[-1] == pytest.approx(711, abs=4 * np.sqrt(2 * 711))

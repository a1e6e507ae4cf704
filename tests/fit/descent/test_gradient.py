"""The gradient of V is its derivative, with noise of both channels and what leaks at the edges of a record."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.fit.descent.in_noise import GroupWeights
from vibrident.fit.descent.settle import Objective
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate

RATE_HZ = 10e3
TRUE = {"sensitivity": 0.1, "natural_frequency": 900.0, "damping_ratio": 0.004}


def objective_of(*, edges: bool, reference_noise: float) -> tuple[Objective, Coordinates]:
    """Return V of two shocks of a lightly damped sensor, 1 % from the truth."""
    calibration = simulate(
        ("accelerometer", TRUE), "shock", samples=1200, sampling_rate_hz=RATE_HZ, repeats=2, response_noise=1e-3, seed=5
    )
    start = {name: 1.01 * value for name, value in TRUE.items()}
    model = parse("accelerometer")
    problem = BinProblem.build(calibration.records, model, method("bandlimited"), "acceleration", start)
    band = Band(problem, 2000.0, edges=edges)
    coordinates = Coordinates.at(model, start, (10.0, 2000.0))
    weights = []
    for group in band.groups:
        level = 1e-4 / (1.0 + np.arange(group.grid.bins) / 50.0) ** 2 * np.ones_like(group.response.real)
        weights.append(GroupWeights(level, reference_noise * np.ones_like(level), np.ones_like(level)))
    return Objective(band, coordinates, weights), coordinates


@pytest.mark.parametrize("edges", [False, True])
@pytest.mark.parametrize("reference_noise", [0.0, 1e-2])
def test_it_is_the_derivative(edges: bool, reference_noise: float) -> None:
    """Without the turn of the columns at the edges with the poles it was 26 times too small."""
    objective, coordinates = objective_of(edges=edges, reference_noise=reference_noise)
    z = coordinates.first
    local = objective(z)
    steps = 1e-4 / np.sqrt(np.diag(local.matrix))
    numerical = [
        (objective(z + step).cost - objective(z - step).cost) / (2.0 * np.max(step)) for step in np.diag(steps)
    ]
    scale = np.sqrt(np.diag(local.matrix) * local.cost)
    np.testing.assert_allclose(-2.0 * local.gradient / scale, numerical / scale, atol=1e-4)  # of the differences


def test_what_leaks_at_the_edges_is_no_information() -> None:
    """Its amounts are noise; what they turn by curves V, but tells nothing of the poles."""
    objective, coordinates = objective_of(edges=True, reference_noise=0.0)
    point = objective.at(coordinates.first)
    without_edges = np.sum(
        [np.einsum("rik,rk,rjk->ij", p.jacobian.conj(), p.weight, p.jacobian).real for p in point.groups], axis=0
    )
    np.testing.assert_allclose(point.matrix, without_edges, rtol=1e-9)
    assert np.all(np.diag(point.curvature) > np.diag(point.matrix) * (1.0 - 1e-9))

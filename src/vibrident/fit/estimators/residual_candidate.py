"""A network beside the physics before its judgement: the start and the course of its training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.backend import jnp
from vibrident.data.records import FloatArray
from vibrident.fit.estimators.base import Estimate
from vibrident.fit.optimise import Progress, Trace, levenberg_marquardt
from vibrident.fit.problem import Coordinates, Evidence, Local
from vibrident.fit.problem.network_problem import require_rational
from vibrident.fit.problem.time_domain import TimeProblem, evaluate
from vibrident.physics.network.residual import initial_weights, with_residual
from vibrident.physics.network.sensitivity import NormalEquations

#: Deviation of a weight from its start, in coordinates, that costs as much as one standard
#: deviation of noise: enough to separate weights that the data cannot, too little to move others.
PRIOR = {
    "memory_frequency": 1.0,
    "memory_damping": 0.5,
    "memory_weight": 0.3,
    "odd_weight": 3.0,
    "odd_slope": 1.0,
    "even_weight": 3.0,
    "even_slope": 1.0,
}


@dataclass(frozen=True, eq=False)
class ResidualCandidate:
    """A network, with or without a residual, and the state of its training."""

    problem: TimeProblem
    coordinates: Coordinates
    z: FloatArray
    noise: FloatArray
    trace: Trace | None = None

    @classmethod
    def physics(cls, plain: Estimate, evidence: Evidence) -> ResidualCandidate:
        """Return the physics alone, from the estimate of the plain network."""
        values = plain.coordinates.values(plain.z)
        network = plain.findings.network
        assert network is not None
        step = plain.findings.method
        require_rational(evidence.model)
        problem = TimeProblem.build(
            evidence.records, evidence.model, step, evidence.quantity, values
        )
        return cls(problem, plain.coordinates, np.asarray(plain.z), network.noise)

    def args(self, lanes: np.ndarray) -> tuple[Any, ...]:
        """Return the arguments of the residual over the lanes chosen, shape (M,)."""
        first, *remaining = self.problem.data
        data = (first._replace(weight=first.weight * lanes), *remaining)
        return (
            self.coordinates,
            self.problem.layout,
            data,
            jnp.asarray(self.problem.by_lane(self.noise)),
        )

    def normal(self, lanes: np.ndarray) -> NormalEquations:
        """Return the normal equations at z over the lanes chosen."""
        return evaluate(jnp.asarray(self.z), *self.args(lanes))

    def residuals(self, lanes: np.ndarray) -> FloatArray:
        """Return the residual, zero outside the lanes chosen, shape (L, M).

        All lanes determine initial states and offsets.
        """
        problem = self.problem
        residual = np.asarray(problem.lanes.response) - np.asarray(
            self.normal(np.ones_like(lanes)).response
        )
        return residual * np.asarray(problem.lanes.weight) * lanes

    def trained(
        self, lanes: np.ndarray, progress: Progress, tolerance: float = 0.1
    ) -> ResidualCandidate:
        """Return the candidate trained on the lanes chosen, from z.

        The noise is read again after each round. ``tolerance``: of the cost; the default suits a
        trial.
        """
        candidate = self
        prior = (jnp.asarray(self.coordinates.first), jnp.asarray(prior_weights(self.coordinates)))
        for _ in range(2):
            args = (candidate.args(lanes), *prior)
            trace = levenberg_marquardt(
                _penalised_normal,
                candidate.z,
                args,
                tolerance=tolerance,
                max_evaluations=30,
                progress=progress,
            )
            candidate = replace(candidate, z=trace.last, trace=trace)
            candidate = replace(candidate, noise=_noise(candidate, lanes))
        return candidate


def _penalised_normal(z: Any, args: Any) -> Local:
    """Return the normal equations with the prior of the weights."""
    inner, centre, weight = args
    normal = evaluate(jnp.asarray(z), *inner)
    deviation = z - centre
    return Local(
        normal.matrix + jnp.diag(weight),
        normal.gradient - weight * deviation,
        normal.cost + jnp.sum(weight * deviation**2),
    )


def prior_weights(coordinates: Coordinates) -> FloatArray:
    """Return the strength by which the prior draws weights to their start, shape (p,).

    It is zero for the parameters of the physics.
    """
    return np.array([PRIOR.get(spec.name, np.inf) for spec in coordinates.model.parameters]) ** -2


def _noise(candidate: ResidualCandidate, lanes: np.ndarray) -> FloatArray:
    """Return the noise of every record from the lanes chosen.

    A record without chosen lanes has noise in proportion to its size, as the other records.
    """
    problem = candidate.problem
    record_of_lane = problem.by_lane(np.arange(len(problem.records)), fill=-1).astype(int)
    squares = np.sum(candidate.residuals(lanes) ** 2, axis=0)
    counts = np.sum(np.asarray(problem.lanes.weight), axis=0) * lanes
    used = record_of_lane >= 0
    total, number = (
        np.bincount(record_of_lane[used], weights=sums[used], minlength=len(problem.records))
        for sums in (squares, counts)
    )
    has_lanes = number > 0
    deviation = np.array(
        [float(np.std(record.response[record.mask])) for record in problem.records]
    )
    relative = np.sqrt(np.sum(total[has_lanes]) / np.sum((number * deviation**2)[has_lanes]))
    noise = np.sqrt(
        np.where(has_lanes, total / np.maximum(number, 1.0), (relative * deviation) ** 2)
    )
    return np.maximum(noise, problem.noise_floor)


def beginning_network(
    structure: tuple[str, ...], physics: ResidualCandidate, train: np.ndarray
) -> ResidualCandidate:
    """Return a network that does nothing yet.

    Its recurrent neurons have the frequency that promises the largest gain on the residual.
    """
    if "memory" not in structure:
        return network_beside(structure, physics, {})
    low, high = physics.coordinates.band_hz.tolist()
    highest = min(
        3.0 * high, 0.4 * max(record.sampling_rate_hz for record in physics.problem.records)
    )
    frequencies = np.geomspace(low, highest, max(2, int(np.log10(highest / low) * 24)))
    scores = []
    trial = network_beside(("memory",), physics, {"memory_frequency": high, "memory_damping": 0.1})
    names = trial.coordinates.model.parameter_names
    for damping in (0.03, 0.2):
        for frequency in frequencies:
            z = np.array(trial.z)
            z[names.index("memory_frequency")] = np.log(frequency / high)
            z[names.index("memory_damping")] = np.arcsinh(damping)
            normal = replace(trial, z=z).normal(train)
            scores.append(
                (
                    _promised_gain(np.asarray(normal.matrix), np.asarray(normal.gradient)),
                    frequency,
                    damping,
                )
            )
    _, frequency, damping = max(scores)
    return network_beside(
        structure, physics, {"memory_frequency": float(frequency), "memory_damping": damping}
    )


def _promised_gain(matrix: FloatArray, gradient: FloatArray) -> float:
    """Return the fall of the cost that a full step promises while the physics follows."""
    movable = np.diag(matrix) > 0
    scale = np.sqrt(np.diag(matrix)[movable])
    values, vectors = np.linalg.eigh(matrix[np.ix_(movable, movable)] / scale[:, None] / scale)
    projected = vectors.T @ (gradient[movable] / scale)
    return float(np.sum(projected[values > 1e-9] ** 2 / values[values > 1e-9]))


def network_beside(
    structure: tuple[str, ...], physics: ResidualCandidate, memory: Mapping[str, float]
) -> ResidualCandidate:
    """Return the physics as trained, with a network beside it that does nothing yet."""
    problem = physics.problem
    previous = physics.coordinates
    frame = problem.frame
    model = with_residual(frame.model, structure)
    response_size = float(previous.response_size)
    start = dict(
        zip(previous.model.parameter_names, np.asarray(previous.start).tolist(), strict=True)
    )
    start |= initial_weights(structure, response_size, memory)
    values = {**start, **previous.values(physics.z)}
    network = TimeProblem.build(problem.records, model, frame.method, frame.quantity, values)
    coordinates = Coordinates.at(model, start, previous.band_hz, response_size)
    z = np.concatenate([physics.z, coordinates.first[len(physics.z) :]])
    return ResidualCandidate(network, coordinates, z, physics.noise)

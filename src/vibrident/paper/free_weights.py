"""The same network with free weights: trained entry by entry, then read back as a sensor.

The tied network has as many unknowns as the sensor has parameters; the free one has n² + n q + n +
q weights, n² of which only choose coordinates for the hidden states. It starts from the tied
weights and shows what the data say when the physics is not imposed; its parameters come from
eigenvalues and the network's own response (or, as in the paper, entry by entry of Euler's W1 and
W3).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from vibrident.base.backend import jax, jnp
from vibrident.base.errors import ModelError
from vibrident.data.records import FloatArray
from vibrident.fit.estimators import Estimate, Ipnn
from vibrident.fit.estimators.findings import Findings
from vibrident.fit.optimise import Progress, Trace, levenberg_marquardt, silent
from vibrident.fit.problem import Coordinates, Evidence
from vibrident.fit.problem.network_problem import require_rational
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.physics.discretisation import Weights, method
from vibrident.physics.network.readback import Reading, physics_from_weights
from vibrident.physics.network.sensitivity import NormalEquations, normal_equations


@dataclass(frozen=True)
class FreeIpnn(Ipnn):
    """Settings of the network with free weights.

    Attributes:
        reading: how physics is read from the weights: ``eigenvalues``, or the paper's ``elements``.
    """

    title: ClassVar[str] = "the network with free weights"
    is_tied: ClassVar[bool] = False

    reading: Reading = "eigenvalues"

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Train the tied network, then all its weights; raise as ``Ipnn`` and :func:`train_free`."""
        require_rational(evidence.model)
        tied = super().fit(evidence, progress)
        coordinates = tied.coordinates
        network = tied.findings.network
        assert network is not None
        problem = TimeProblem.build(
            evidence.records,
            evidence.model,
            method(self.discretisation),
            evidence.quantity,
            coordinates.values(tied.z),
        )
        z, covariance, trace = train_free(
            problem, coordinates, tied.z, network.noise, self.reading, progress
        )
        found = Findings(replace(network, weights="", reading=self.reading))
        return replace(
            tied,
            z=z,
            covariance=covariance,
            trace=trace,
            begin=None,
            findings=found,
            predicted=None,
            in_noise=None,
        )


def unpack(vector: Any, states: int, terms: int) -> Weights:
    """Return the weights from their entries one after the other; ``vector`` may be traced."""
    sizes = (states * states, states * terms, states, terms)
    phi, gamma, c, d = (vector[sum(sizes[:i]) : sum(sizes[: i + 1])] for i in range(4))
    return Weights(phi.reshape(states, states), gamma.reshape(states, terms), c, d)


def train_free(
    problem: TimeProblem,
    coordinates: Coordinates,
    z: FloatArray,
    noise: FloatArray,
    reading: Reading,
    progress: Progress,
) -> tuple[FloatArray, FloatArray, Trace]:
    """Train all weights from the tied optimum ``z``.

    Returns:
        Coordinates read back, shape (p,); their covariance for white noise; the optimiser's trace.

    Raises:
        ModelError: the model has add-ons, records differ in sampling rate, or the weights are no
            oscillator's.
    """
    model = coordinates.model
    layout = problem.layout
    if model.add_ons or len(problem.intervals_s) > 1:
        raise ModelError(
            "The network's weights can be free only for a core model at one sampling rate.",
            expected="a model without add-ons, records of one rate",
            found=f"model {model.name!r}, {len(problem.intervals_s)} sampling rates",
            where="estimator",
            remedy="use the estimator 'ipnn', whose weights are tied to the physics",
        )
    values = coordinates.values(z)
    tied = np.concatenate([np.ravel(np.asarray(weight)[0]) for weight in problem.weights(values)])
    scale = float(model.rational(values, layout.quantity).angular_scale) ** np.arange(layout.order)
    args = (
        problem.lanes,
        jnp.asarray(problem.by_lane(noise)),
        layout.order,
        layout.terms,
        layout.segments,
    )
    trace = levenberg_marquardt(_objective, tied, args, tolerance=1e-2, progress=progress)
    interval = float(problem.intervals_s[0])

    def read(vector: FloatArray) -> FloatArray:
        weights = unpack(vector, layout.order, layout.terms)
        physical = Weights(
            weights.transition * scale[:, None] / scale, weights.drive * scale[:, None], weights.output / scale,
            weights.feedthrough,
        )  # fmt: skip
        found = physics_from_weights(physical, interval, model, layout.method.name, reading)
        return coordinates.place(found)

    best = trace.last
    normal = _objective(jnp.asarray(best), args)
    steps = 1e-5 * np.maximum(np.abs(best), 1e-3)
    slopes = np.stack(
        [
            (read(best + e) - read(best - e)) / (2 * s)
            for e, s in zip(np.diag(steps), steps, strict=True)
        ],
        axis=1,
    )
    # The n² directions that only turn the hidden states change nothing: their zero eigenvalues are
    # left out.
    covariance = (
        slopes @ np.linalg.pinv(np.asarray(normal.matrix), rcond=1e-11, hermitian=True) @ slopes.T
    )
    path = np.stack([read(point) for point in trace.coordinates])
    return read(best), covariance, replace(trace, coordinates=path)


def _objective(vector: Any, args: Any) -> NormalEquations:
    return _evaluate(vector, *args)


@functools.partial(jax.jit, static_argnames=("states", "terms", "segments"))
def _evaluate(
    vector: Any, lanes: Any, noise: Any, states: int, terms: int, segments: int
) -> NormalEquations:
    def batch(v: Any) -> Weights:
        return Weights(*(w[None] for w in unpack(v, states, terms)))

    return normal_equations(batch(vector), jax.jacfwd(batch)(vector), lanes, noise, segments)

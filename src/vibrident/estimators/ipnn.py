"""The network, trained end to end on excitation and response in time: the paper's method, with its weak points mended.

Weights tied to the physics through the chosen discretisation, initial state and offset of every record found exactly,
each record weighted by its own noise. Trained by Levenberg–Marquardt, or by Adam as in the paper. For white noise on the
response this is the maximum-likelihood estimate.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Literal

import equinox as eqx
import numpy as np

from vibrident.backend import jnp
from vibrident.discretize import method
from vibrident.errors import ModelError
from vibrident.estimators.base import Estimate
from vibrident.estimators.objectives import time_objective
from vibrident.estimators.optimise import Progress, Trace, adam, levenberg_marquardt, silent
from vibrident.estimators.start import start_values
from vibrident.problem import Coordinates, Evidence, TimeProblem
from vibrident.problem.time_domain import physical_normal
from vibrident.records import FloatArray

#: Rounds of training with refreshed noise weights and delay.
ROUNDS = 3
#: Noise below this part of a record's response is not believed: rounding and interpolation lie there.
LEAST_NOISE = 1e-9


@dataclass(frozen=True)
class Ipnn:
    """Settings of the estimator ``ipnn``.

    Attributes:
        discretisation: euler | zoh | foh | tustin | bandlimited.
        optimiser: ``lm`` (Levenberg–Marquardt) or ``adam``.
        learning_rate: of Adam.
        steps: of Adam.
    """

    discretisation: str = "bandlimited"
    optimiser: Literal["lm", "adam"] = "lm"
    learning_rate: float = 0.001
    steps: int = 1500
    name: str = "ipnn"

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Train the network.

        Raises:
            ModelError: there are no records, or none with a reference.
            InputError: no record is long enough.
        """
        if not evidence.records or evidence.first_look is None:
            raise ModelError(
                "The network is trained on records with a reference.",
                expected="[[records]] with a reference channel",
                found="a table" if evidence.calibration.table is not None else "free decays only",
                where="estimator",
                remedy="use the estimator 'ml' for a table; add a record with a reference to free decays",
            )
        start = start_values(evidence.first_look, evidence.model)
        step = method(self.discretisation)
        problem, trace, noise = None, None, None
        coordinates = Coordinates.at(evidence.model, start, evidence.band_hz)
        z = coordinates.first
        for round_ in range(ROUNDS):
            values = coordinates.values(z)
            if problem is None or _delay_moved(problem, values):
                problem = TimeProblem.build(evidence.records, evidence.model, step, evidence.quantity, values)
            noise = record_noise(problem, coordinates, z)
            before = z
            trace = self._train(problem, coordinates, z, noise, progress)
            z = trace.last
            if round_ and np.allclose(before, z, rtol=1e-7, atol=1e-8):
                break
        assert problem is not None and trace is not None and noise is not None
        noise = record_noise(problem, coordinates, z)
        args = (coordinates, problem.layout, problem.data, jnp.asarray(problem.by_lane(noise)))
        matrix = np.asarray(_normal_matrix(jnp.asarray(z), args))
        freedom = float(np.sum(problem.degrees_of_freedom)) - len(z)
        settings = {
            "discretisation": self.discretisation,
            "optimiser": trace.optimiser,
            "inputs_per_step": problem.layout.terms,
        }
        covariance = np.linalg.pinv(matrix, hermitian=True)
        return Estimate("ipnn", coordinates, z, covariance, freedom, trace, settings)

    def _train(
        self, problem: TimeProblem, coordinates: Coordinates, z: FloatArray, noise: FloatArray, progress: Progress
    ) -> Trace:
        args = (coordinates, problem.layout, problem.data, jnp.asarray(problem.by_lane(noise)))
        if self.optimiser == "adam":
            train = functools.partial(adam, learning_rate=self.learning_rate, steps=self.steps)
            return train(time_objective, z, args, progress=progress)
        return levenberg_marquardt(time_objective, z, args, progress=progress)


def record_noise(problem: TimeProblem, coordinates: Coordinates, z: FloatArray) -> FloatArray:
    """Standard deviation of each record's residual, shape (records,)."""
    predicted, _ = problem.predict(coordinates, z)
    freedom = problem.degrees_of_freedom
    noise = np.zeros(len(predicted))
    for index, (record, series) in enumerate(zip(problem.records, predicted, strict=True)):
        used = record.mask & np.isfinite(series)
        residual = record.response[used] - series[used]
        floor = LEAST_NOISE * float(np.std(record.response[record.mask]))
        estimate = np.sqrt(float(np.sum(residual**2)) / max(freedom[index], 1.0))
        noise[index] = max(estimate, floor, np.finfo(float).tiny)
    return noise


def _delay_moved(problem: TimeProblem, values: dict[str, float]) -> bool:
    """Whether the inputs were interpolated at another delay than is now estimated, by more than 1e-3 of a sample."""
    moved = abs(values.get("delay", 0.0) - problem.delay_s)
    return bool(moved > 1e-3 * np.min(problem.intervals_s))


@eqx.filter_jit
def _normal_matrix(z: Any, args: Any) -> Any:
    return physical_normal(z, *args).matrix


__all__ = ["Ipnn", "record_noise"]

"""Cost, gradient and normal matrix of the residual that a calibration's estimator used, near any parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.estimators.likelihood import solved_problem
from vibrident.judge import Fitted
from vibrident.problem import Coordinates, FrequencyProblem, Local, NetworkProblem
from vibrident.records import FloatArray


@dataclass(frozen=True, eq=False)
class Score:
    """A calibration's residual.

    Attributes:
        coordinates: its coordinates.
        problem: in time, for an estimate at the samples, or in frequency, for every other.
        noise: standard deviation by which each record is weighted, shape (records,); None in frequency.
    """

    coordinates: Coordinates
    problem: NetworkProblem | FrequencyProblem
    noise: FloatArray | None = None

    @classmethod
    def of(cls, fitted: Fitted) -> Score:
        """The residual of an estimate, weighted as there."""
        evidence, estimate = fitted.evidence, fitted.estimate
        if estimate.criterion == "samples":
            assert estimate.problem is not None
            return cls(estimate.coordinates, estimate.problem, np.array(estimate.settings["noise"]))
        return cls(estimate.coordinates, solved_problem(estimate, evidence))

    def local(self, z: FloatArray) -> Local:
        """Cost, gradient and normal matrix at ``z``, shape (p,)."""
        if isinstance(self.problem, FrequencyProblem):
            return self.problem.normal(z, self.coordinates)
        assert self.noise is not None
        found = self.problem.normal(z, self.coordinates, self.noise)
        return Local(np.asarray(found.matrix), np.asarray(found.gradient), float(found.cost))

    def deviance(self, z: FloatArray) -> float:
        """−2 log likelihood at ``z`` up to a constant, with each record's noise estimated there."""
        if self.noise is None or isinstance(self.problem, FrequencyProblem):
            return self.local(z).cost
        return float(2.0 * self.problem.degrees_of_freedom @ np.log(self.noise))

    def colour(self, z: FloatArray) -> float:
        """Mean of the residual's spectrum at ``z``, weighted by the response; 1 for white noise, at least 1."""
        if self.noise is None or isinstance(self.problem, FrequencyProblem):
            return 1.0
        level, power = 0.0, 0.0
        for record, series, noise in zip(
            self.problem.records, self.problem.predict(self.coordinates, z), self.noise, strict=True
        ):
            used = record.mask & np.isfinite(series)
            residual = np.where(used, (record.response - series) / noise, 0.0)
            response = np.abs(np.fft.rfft(np.where(used, series - series[used].mean(), 0.0))) ** 2 / noise**2
            level += float(np.abs(np.fft.rfft(residual)) ** 2 @ response) / max(float(used.sum()), 1.0)
            power += float(np.sum(response))
        return max(level / max(power, np.finfo(float).tiny), 1.0)

    def near(self, z: FloatArray) -> Score:
        """The same with inputs interpolated at the delay of ``z``, and each record weighted by its residual there."""
        if isinstance(self.problem, FrequencyProblem):
            return self
        assert self.noise is not None
        problem = self.problem.at_delay_of(self.coordinates.values(z))
        predicted = problem.predict(self.coordinates, z)
        noise = []
        for record, series, freedom in zip(problem.records, predicted, problem.degrees_of_freedom, strict=True):
            used = record.mask & np.isfinite(series)
            squares = float(np.sum((record.response[used] - series[used]) ** 2))
            noise.append(np.sqrt(squares / max(freedom, 1.0)))
        return replace(self, problem=problem, noise=np.maximum(noise, problem.noise_floor))

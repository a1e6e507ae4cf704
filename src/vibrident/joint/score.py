"""Cost, gradient and normal matrix of the residual that a calibration's estimator used, near any parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from vibrident.estimators.likelihood import solved_problem
from vibrident.judge import Fitted
from vibrident.problem import Coordinates, FrequencyProblem, Local, NetworkProblem
from vibrident.records import FloatArray


@dataclass(frozen=True, eq=False)
class Score(ABC):
    """A calibration's residual."""

    coordinates: Coordinates  # its coordinates
    noise: FloatArray | None  # standard deviation by which each record is weighted, shape (records,); None in frequency

    @classmethod
    def of(cls, fitted: Fitted) -> Score:
        """The residual of an estimate, weighted as there."""
        estimate, network = fitted.estimate, fitted.estimate.findings.network
        if estimate.criterion == "samples" and estimate.problem is not None and network is not None:
            return _OfSamples(estimate.coordinates, network.noise, estimate.problem)
        return _OfResponses(estimate.coordinates, None, solved_problem(estimate, fitted.evidence))

    @property
    def network(self) -> NetworkProblem | None:
        """The network, of an estimate at the samples."""
        return None

    @abstractmethod
    def local(self, z: FloatArray) -> Local:
        """Cost, gradient and normal matrix at ``z``, shape (p,)."""

    def deviance(self, z: FloatArray) -> float:
        """−2 log likelihood at ``z`` up to a constant, with each record's noise estimated there."""
        return self.local(z).cost

    def colour(self, z: FloatArray) -> float:
        """Mean of the residual's spectrum at ``z``, weighted by the response; 1 for white noise, at least 1."""
        del z
        return 1.0

    def near(self, z: FloatArray) -> Score:
        """The same with inputs interpolated at the delay of ``z``, and each record weighted by its residual there."""
        del z
        return self


@dataclass(frozen=True, eq=False)
class _OfResponses(Score):
    """In frequency: of all estimates but those of a network."""

    problem: FrequencyProblem

    def local(self, z: FloatArray) -> Local:
        return self.problem.normal(z, self.coordinates)


@dataclass(frozen=True, eq=False)
class _OfSamples(Score):
    """Of a network."""

    noise: FloatArray
    problem: NetworkProblem

    @property
    def network(self) -> NetworkProblem:
        return self.problem

    def local(self, z: FloatArray) -> Local:
        found = self.problem.normal(z, self.coordinates, self.noise)
        return Local(np.asarray(found.matrix), np.asarray(found.gradient), float(found.cost))

    def deviance(self, z: FloatArray) -> float:
        del z
        return float(2.0 * self.problem.degrees_of_freedom @ np.log(self.noise))

    def colour(self, z: FloatArray) -> float:
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
        problem = self.problem.at_delay_of(self.coordinates.values(z))
        predicted = problem.predict(self.coordinates, z)
        noise = []
        for record, series, freedom in zip(problem.records, predicted, problem.degrees_of_freedom, strict=True):
            used = record.mask & np.isfinite(series)
            squares = float(np.sum((record.response[used] - series[used]) ** 2))
            noise.append(np.sqrt(squares / max(freedom, 1.0)))
        return replace(self, problem=problem, noise=np.maximum(noise, problem.noise_floor))

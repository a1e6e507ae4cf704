"""A calibration's estimate as moments of a joint fit: its score and the covariance of the score.

An estimate ẑ with covariance C solves g(z) = 0, g the gradient of its cost (including weights by the noise's spectrum
and a correction for bias). Elsewhere

    m(z) = g(z) − g(ẑ),   cov m = S = M^½ K M^½,   K = M(ẑ)^½ C M(ẑ)^½,

with M the normal matrix JᵀJ. K is one for white noise of known level; it includes coloured noise and a misfit that the
uncertainties cover. The joint estimate minimises Σ mᵀ S⁻¹ m over the calibrations (generalised method of moments;
Hansen 1982), which weights each by its information. Near ẑ this is (z − ẑ)ᵀ C⁻¹ (z − ẑ), so that a joint fit of one
calibration is its own fit; far from ẑ it follows the residual, unlike a quadratic.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.estimators.likelihood import solved_problem
from vibrident.fit.information import inverse_normal
from vibrident.fit.judge import Fitted
from vibrident.fit.problem import Coordinates, FrequencyProblem, Local, NetworkProblem

SMALLEST = 1e-12  # scaled eigenvalues below this are rounding: such a direction is not identifiable


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


@dataclass(frozen=True, eq=False)
class MomentConditions:
    """The score of a calibration."""

    score: Score  # near the joint estimate
    offset: FloatArray  # g(ẑ), shape (p,)
    scale: FloatArray  # square roots of the diagonal of M(ẑ), shape (p,)
    inverse_colour: FloatArray  # K⁻¹ in the scaled coordinates, shape (p, p)

    @classmethod
    def of(cls, own: Score, z: FloatArray, covariance: FloatArray, near: Score) -> MomentConditions:
        """From an estimate ``z``, shape (p,), with its covariance as stated, shape (p, p).

        ``own``: the residual, with each record weighted by its residual at the estimate; ``z``: the estimate;
        ``covariance``: of it; ``near``: the same near the joint estimate: a larger residual there lowers the
        calibration's weight.
        """
        here = own.local(z)
        scale = _scale(here.matrix)
        root, _ = _roots(here.matrix, scale)
        colour = root @ (covariance * np.outer(scale, scale)) @ root
        offset = replace(own, noise=near.noise).local(z).gradient
        return cls(near, offset, scale, _inverse(colour))

    @classmethod
    def plain(cls, near: Score, z: FloatArray, variance: float) -> MomentConditions:
        """For a calibration without its own estimate: its cost, for noise of this many times its level."""
        here = near.local(z)
        return cls(near, np.zeros_like(here.gradient), _scale(here.matrix), np.eye(len(z)) / variance)

    def weight(self, z: FloatArray) -> FloatArray:
        """S⁻¹ at ``z``, shape (p, p)."""
        _, inverse = _roots(self.score.local(z).matrix, self.scale)
        return (inverse @ self.inverse_colour @ inverse) / np.outer(self.scale, self.scale)

    def information(self, z: FloatArray) -> FloatArray:
        """Information on the calibration's parameters at ``z``: C⁻¹ at its own estimate; shape (p, p)."""
        root, _ = _roots(self.score.local(z).matrix, self.scale)
        return (root @ self.inverse_colour @ root) * np.outer(self.scale, self.scale)

    def local(self, z: FloatArray, weight: FloatArray) -> Local:
        """Cost, gradient and normal matrix of mᵀ S⁻¹ m, with S⁻¹ held."""
        found = self.score.local(z)
        moment = found.gradient - self.offset
        return Local(
            found.matrix @ weight @ found.matrix, found.matrix @ weight @ moment, float(moment @ weight @ moment)
        )

    def step(self, z: FloatArray) -> FloatArray:
        """Step from ``z`` to the calibration's own estimate, to first order, shape (p,)."""
        found = self.score.local(z)
        return inverse_normal(found.matrix) @ (found.gradient - self.offset)


def _scale(matrix: FloatArray) -> FloatArray:
    diagonal = np.diag(matrix)
    return np.sqrt(np.maximum(diagonal, 1e-30 * max(float(np.max(diagonal)), np.finfo(float).tiny)))


def _roots(matrix: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    """M^½ and M^−½ in scaled coordinates; the information of a direction is at least rounding."""
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    kept = np.maximum(values, SMALLEST * np.max(values))
    return (vectors * np.sqrt(kept)) @ vectors.T, (vectors / np.sqrt(kept)) @ vectors.T


def _inverse(matrix: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(matrix)
    return (vectors / np.maximum(values, SMALLEST * np.max(values))) @ vectors.T

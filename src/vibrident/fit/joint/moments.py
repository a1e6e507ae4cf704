"""A calibration's estimate as moment conditions of a joint fit: its score and the covariance of the score.

An estimate ẑ with covariance C solves g(z) = 0, g the gradient of its cost (including weights by the noise's spectrum
and a correction for bias). Elsewhere

    m(z) = g(z) − g(ẑ),   cov m = S = M^½ K M^½,   K = M(ẑ)^½ C M(ẑ)^½,

with M the normal matrix JᵀJ. K is one for white noise of known level; it includes coloured noise and a misfit that the
uncertainties cover. The joint estimate minimises Σ mᵀ S⁻¹ m over the calibrations (generalised method of moments;
Hansen 1982), which weights each by its information. Near ẑ this is (z − ẑ)ᵀ C⁻¹ (z − ẑ), so that a joint fit of one
calibration is its own fit; far from ẑ it follows the residual, unlike a quadratic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.descent.sandwich import hac_covariance
from vibrident.fit.estimators.kinds.ml import solved_problem
from vibrident.fit.information import SMALLEST, inverse_normal
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.problem import Coordinates, Local


@dataclass(frozen=True, eq=False)
class Score:
    """A calibration's residual: at points, at the samples of records, or of free decays."""

    coordinates: Coordinates  # its coordinates
    problem: Any  # with ``normal``
    noise: FloatArray | None = (
        None  # standard deviation by which samples of each record are weighted, shape (records,)
    )

    @classmethod
    def of(cls, fitted: Fitted) -> Score:
        """The residual of an estimate, weighted as there."""
        estimate = fitted.estimate
        network = fitted.estimate.findings.network
        if estimate.findings.decays is not None:
            from vibrident.fit.decay.estimate import decays_at  # only where there are decays

            return cls(estimate.coordinates, decays_at(estimate)[0].fit.problem)
        if estimate.in_noise is not None:
            return cls(estimate.coordinates, estimate.in_noise)
        if estimate.criterion == "samples" and network is not None:
            return cls(estimate.coordinates, estimate.problem, network.noise)
        return cls(estimate.coordinates, solved_problem(estimate, fitted.evidence))

    def local(self, z: FloatArray, _: Any = None) -> Local:
        """Cost, gradient and normal matrix at ``z``, shape (p,)."""
        more = () if self.noise is None else (self.noise,)
        found = self.problem.normal(z, self.coordinates, *more)
        return Local(np.asarray(found.matrix), np.asarray(found.gradient), float(found.cost))

    def deviance(self, z: FloatArray) -> float:
        """−2 log likelihood at ``z`` up to a constant, with each record's noise estimated there."""
        if self.noise is None:
            return self.local(z).cost
        return float(2.0 * self.problem.degrees_of_freedom @ np.log(self.noise))

    def near(self, z: FloatArray) -> Score:
        """The same with inputs interpolated at the delay of ``z``, and each record weighted by its residual there."""
        if self.noise is None:
            return self
        problem = self.problem.at_delay_of(self.coordinates.values(z))
        noise = problem.record_noise(problem.normal(z, self.coordinates, self.noise), self.noise)
        return replace(self, problem=problem, noise=noise)

    def covariance(self, z: FloatArray) -> FloatArray:
        """Of what the residual at ``z`` says of the coordinates, in its own spectrum, shape (p, p)."""
        if self.noise is None:
            return inverse_normal(self.local(z).matrix)
        lines = self.problem.lines(z, self.coordinates, self.noise)
        return hac_covariance(lines, self.problem.degrees_of_freedom)[0]


@dataclass(frozen=True, eq=False)
class MomentConditions:
    """The score of a calibration about its estimate."""

    score: Score
    offset: FloatArray  # g(ẑ), shape (p,)
    scale: FloatArray  # square roots of the diagonal of M(ẑ), shape (p,)
    inverse_colour: FloatArray  # K⁻¹ in the scaled coordinates, shape (p, p)

    @classmethod
    def of(
        cls, own: Score, z: FloatArray, covariance: FloatArray, near: Score, *, optimum: bool = True
    ) -> MomentConditions:
        """From an estimate ``z``, shape (p,), with its covariance as stated, shape (p, p).

        ``own``: its score; ``near``: with inputs interpolated at the joint delay; ``optimum``: whether it is one; else
        ``z`` is a place where the residual is looked at.
        """
        here = own.local(z)
        diagonal = np.diag(here.matrix)
        scale = np.sqrt(
            np.maximum(diagonal, SMALLEST * max(float(np.max(diagonal)), np.finfo(float).tiny))
        )
        root, _ = _roots(here.matrix, scale)
        values, vectors = _bounded(root @ (covariance * np.outer(scale, scale)) @ root)
        offset = here.gradient if optimum else np.zeros_like(here.gradient)
        return cls(replace(near, noise=own.noise), offset, scale, (vectors / values) @ vectors.T)

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
        half = found.matrix @ weight
        return Local(half @ found.matrix, half @ moment, float(moment @ weight @ moment))

    def step(self, z: FloatArray) -> FloatArray:
        """Gauss–Newton step from ``z`` to the calibration's own estimate, shape (p,)."""
        found = self.score.local(z)
        return inverse_normal(found.matrix) @ (found.gradient - self.offset)


def _bounded(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, at least rounding of the largest, and eigenvectors."""
    values, vectors = np.linalg.eigh(matrix)
    return np.maximum(values, SMALLEST * np.max(values)), vectors


def _roots(matrix: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    """M^½ and M^−½ in scaled coordinates."""
    values, vectors = _bounded(matrix / np.outer(scale, scale))
    return (vectors * np.sqrt(values)) @ vectors.T, (vectors / np.sqrt(values)) @ vectors.T

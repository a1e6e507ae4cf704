"""A calibration's estimate as moment conditions of a joint fit: its score and its covariance.

An estimate ẑ with covariance C solves g(z) = 0, g the gradient of its cost (including weights by
the noise's spectrum and a correction for bias). Elsewhere

    m(z) = g(z) − g(ẑ),   cov m = S = M^½ K M^½,   K = M(ẑ)^½ C M(ẑ)^½,

with M the normal matrix JᵀJ. K is one for white noise of known level; it includes coloured noise
and a misfit that the uncertainties cover. The joint estimate minimises Σ mᵀ S⁻¹ m over the
calibrations (generalised method of moments; Hansen 1982), which weights each by its information.
Near ẑ this is (z − ẑ)ᵀ C⁻¹ (z − ẑ), so that a joint fit of one calibration is its own fit; far from
ẑ it follows the residual, unlike a quadratic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.descent.sandwich import hac_covariance
from vibrident.fit.estimators.kinds.ml import solved_problem
from vibrident.fit.information import MIN_SCALED_EIGENVALUE, inverse_normal
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.problem import Coordinates, Local


@dataclass(frozen=True, eq=False)
class CalibrationScore:
    """A calibration's residual: at points, at the samples of records, or of free decays."""

    coordinates: Coordinates
    problem: Any  # an object with a method ``normal``
    #: Standard deviation by which samples of each record are weighted, shape (records,).
    noise: FloatArray | None = None

    @classmethod
    def from_fit(cls, fitted: Fitted) -> CalibrationScore:
        """Build the residual of an estimate, with the weights of its fit."""
        estimate = fitted.estimate
        network = estimate.findings.network
        if estimate.findings.decays is not None:
            from vibrident.fit.decay.estimate import decays_at  # only where there are decays

            return cls(estimate.coordinates, decays_at(estimate)[0].fit.problem)
        if estimate.in_noise is not None:
            return cls(estimate.coordinates, estimate.in_noise)
        if estimate.criterion == "samples" and network is not None:
            return cls(estimate.coordinates, estimate.problem, network.noise)
        return cls(estimate.coordinates, solved_problem(estimate, fitted.evidence))

    def local(self, z: FloatArray, _: Any = None) -> Local:
        """Return cost, gradient and normal matrix at ``z``, shape (p,)."""
        noise = () if self.noise is None else (self.noise,)
        normal = self.problem.normal(z, self.coordinates, *noise)
        return Local(np.asarray(normal.matrix), np.asarray(normal.gradient), float(normal.cost))

    def deviance(self, z: FloatArray) -> float:
        """Return −2 log likelihood at ``z`` up to a constant; of records, that of their noise."""
        if self.noise is None:
            return self.local(z).cost
        return float(2.0 * self.problem.degrees_of_freedom @ np.log(self.noise))

    def near(self, z: FloatArray) -> CalibrationScore:
        """Return the residual with inputs interpolated at the delay of ``z``.

        Each record is weighted by its residual at ``z``.
        """
        if self.noise is None:
            return self
        problem = self.problem.at_delay_of(self.coordinates.values(z))
        noise = problem.record_noise(problem.normal(z, self.coordinates, self.noise), self.noise)
        return replace(self, problem=problem, noise=noise)

    def covariance(self, z: FloatArray) -> FloatArray:
        """Return the covariance of z by the residual there, in its own spectrum, shape (p, p)."""
        if self.noise is None:
            return inverse_normal(self.local(z).matrix)
        lines = self.problem.lines(z, self.coordinates, self.noise)
        return hac_covariance(lines, self.problem.degrees_of_freedom)[0]


@dataclass(frozen=True, eq=False)
class MomentConditions:
    """The score of a calibration about its estimate."""

    score: CalibrationScore
    offset: FloatArray  # g(ẑ), shape (p,)
    scale: FloatArray  # square roots of the diagonal of M(ẑ), shape (p,)
    inverse_colour: FloatArray  # K⁻¹ in the scaled coordinates, shape (p, p)

    @classmethod
    def from_estimate(
        cls,
        score: CalibrationScore,
        z: FloatArray,
        covariance: FloatArray,
        near: CalibrationScore,
        *,
        optimum: bool = True,
    ) -> MomentConditions:
        """Build the conditions from an estimate with its covariance as stated.

        Args:
            score: of the calibration.
            z: the estimate, shape (p,).
            covariance: of the estimate, shape (p, p).
            near: the score with inputs interpolated at the joint delay.
            optimum: whether ``z`` is an optimum, or any place.
        """
        local = score.local(z)
        diagonal = np.diag(local.matrix)
        scale = np.sqrt(
            np.maximum(
                diagonal, MIN_SCALED_EIGENVALUE * max(float(np.max(diagonal)), np.finfo(float).tiny)
            )
        )
        root, _ = _roots(local.matrix, scale)
        values, vectors = _bounded_eigenvalues(root @ (covariance * np.outer(scale, scale)) @ root)
        offset = local.gradient if optimum else np.zeros_like(local.gradient)
        return cls(replace(near, noise=score.noise), offset, scale, (vectors / values) @ vectors.T)

    def weight(self, z: FloatArray) -> FloatArray:
        """Return S⁻¹ at ``z``, shape (p, p)."""
        _, inverse = _roots(self.score.local(z).matrix, self.scale)
        return (inverse @ self.inverse_colour @ inverse) / np.outer(self.scale, self.scale)

    def information(self, z: FloatArray) -> FloatArray:
        """Return the information on the calibration's parameters at ``z``, shape (p, p).

        It is C⁻¹ at its own estimate.
        """
        root, _ = _roots(self.score.local(z).matrix, self.scale)
        return (root @ self.inverse_colour @ root) * np.outer(self.scale, self.scale)

    def local(self, z: FloatArray, weight: FloatArray) -> Local:
        """Return cost, gradient and normal matrix of mᵀ S⁻¹ m, with S⁻¹ held."""
        at_z = self.score.local(z)
        moment = at_z.gradient - self.offset
        weighted = at_z.matrix @ weight
        return Local(weighted @ at_z.matrix, weighted @ moment, float(moment @ weight @ moment))

    def step(self, z: FloatArray) -> FloatArray:
        """Return the Gauss–Newton step from ``z`` to the calibration's own estimate, shape (p,)."""
        local = self.score.local(z)
        return inverse_normal(local.matrix) @ (local.gradient - self.offset)


def _bounded_eigenvalues(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues, at least rounding of the largest, and eigenvectors."""
    values, vectors = np.linalg.eigh(matrix)
    return np.maximum(values, MIN_SCALED_EIGENVALUE * np.max(values)), vectors


def _roots(matrix: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return M^½ and M^−½ in scaled coordinates."""
    values, vectors = _bounded_eigenvalues(matrix / np.outer(scale, scale))
    return (vectors * np.sqrt(values)) @ vectors.T, (vectors / np.sqrt(values)) @ vectors.T

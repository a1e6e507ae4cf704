"""Consistency of calibrations that share parameters: their separate estimates against the covariance of these.

With y the separate estimates, one below the other, and V their covariance, the hypothesis y = A θ leaves contrasts
t = Tᵀ y, Tᵀ A = 0, that are zero but for noise: tᵀ (Tᵀ V T)⁻¹ t is χ² with as many degrees of freedom as there are
contrasts (GUM, JCGM 102, 8; the test of a key comparison, Cox 2002). Systematic effects common to two calibrations are
correlated in V.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, null_space
from scipy.special import chdtrc, fdtrc

from vibrident.information import inverse_normal
from vibrident.joint.sharing import Joint, Place
from vibrident.measure.verdict import REJECTION
from vibrident.records import FloatArray


@dataclass(frozen=True)
class Verdict:
    """χ² of a difference, its degrees of freedom, and the probability of at least this χ² for consistent data."""

    chi2: float
    degrees_of_freedom: int
    probability: float

    @property
    def consistent(self) -> bool:
        """Not rejected."""
        return self.probability >= REJECTION


@dataclass(frozen=True)
class Consistency:
    """The outcome of the comparison."""

    whole: Verdict  # of all shared parameters together
    each: dict[str, Verdict]  # of each shared parameter by itself, by name

    @property
    def worst(self) -> str:
        """The parameter that differs most."""
        return min(self.each, key=lambda name: (self.each[name].probability, -self.each[name].chi2))


def compare(
    numbers: Sequence[Joint],
    places: Sequence[Place],
    estimates: Sequence[FloatArray],
    covariances: Sequence[FloatArray],
    effects: Sequence[FloatArray],
    degrees_of_freedom: float,
) -> Consistency | None:
    """Compare separate estimates; None if nothing is shared.

    Args:
        numbers: of the joint fit.
        places: of each calibration in it.
        estimates: separate estimates of each calibration's coordinates, shapes (p,).
        covariances: of them, from the data alone, shapes (p, p).
        effects: change of all of them for one standard uncertainty of each systematic effect, shapes (Σp,).
        degrees_of_freedom: the least of any covariance.
    """
    whole = np.concatenate([place.matrix for place in places])
    rest = np.concatenate([z - place.offset for z, place in zip(estimates, places, strict=True)])
    covariance = np.asarray(block_diag(*covariances), dtype=float)
    covariance = covariance + sum((np.outer(s, s) for s in effects), np.zeros_like(covariance))
    begin = np.concatenate([[0], np.cumsum([len(place.offset) for place in places])])

    def verdict(rows: FloatArray, at: FloatArray, spread: FloatArray) -> Verdict:
        contrasts = null_space(rows.T)
        left = contrasts.T @ at
        chi2 = float(left @ inverse_normal(contrasts.T @ spread @ contrasts) @ left)
        return Verdict(chi2, len(left), _probability(chi2, len(left), degrees_of_freedom))

    each = {}
    for column, number in enumerate(numbers):
        if len(number.members) > 1:
            index = [int(begin[owner]) + own for owner, own in number.members]
            rows = whole[index][:, [column]]
            found = verdict(rows, rest[index], covariance[np.ix_(index, index)])
            if number.name not in each or found.probability < each[number.name].probability:
                each[number.name] = found
    return Consistency(verdict(whole, rest, covariance), each) if each else None


def _probability(chi2: float, contrasts: int, freedom: float) -> float:
    """Probability of at least this χ²; of Fisher's F if the scale of V is estimated."""
    if np.isfinite(freedom):
        return float(fdtrc(contrasts, max(freedom, 1.0), chi2 / contrasts))
    return float(chdtrc(contrasts, chi2))

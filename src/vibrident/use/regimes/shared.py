"""Parameters of several regimes, with those that stay the same in common.

A parameter whose values in all regimes agree within noise is one number. The values of all regimes
are then those of generalised least squares (Aitken 1935) under that constraint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.tails import chi2_tail
from vibrident.data.records import BoolArray, FloatArray
from vibrident.use.regimes.pieces import PieceEstimate

#: Chance that a parameter that is one number is taken for several.
FALSE_DIFFERENCE = 0.01


@dataclass(frozen=True, eq=False)
class Shared:
    """Parameters of L regimes.

    Attributes:
        is_shared: which of them are one number, shape (P,).
        values: shape (L, P).
        covariances: by noise, shape (L, P, P).
    """

    is_shared: BoolArray
    values: FloatArray
    covariances: FloatArray


def share(regimes: Sequence[PieceEstimate]) -> Shared:
    """Return the parameters of regimes, those in common where the data allow it."""
    values = np.array([regime.values for regime in regimes])
    covariances = np.array([regime.covariance for regime in regimes])
    scale = np.maximum(np.max(np.abs(values), axis=0), np.finfo(float).tiny)
    scaled = values / scale
    informations = np.linalg.pinv(covariances / np.outer(scale, scale), hermitian=True)
    is_shared = _agreeing_parameters(scaled, covariances / np.outer(scale, scale))
    design = _design(len(regimes), is_shared)
    weights = np.zeros((scaled.size, scaled.size))
    count = values.shape[1]
    for number, information in enumerate(informations):
        block = slice(number * count, (number + 1) * count)
        weights[block, block] = information
    normal = design.T @ weights @ design
    inverse = np.linalg.pinv(normal, hermitian=True)
    solution = design @ (inverse @ (design.T @ (weights @ scaled.ravel())))
    covariance = design @ inverse @ design.T
    shape = len(regimes), count, len(regimes), count
    blocks = np.einsum("lplq->lpq", covariance.reshape(shape))
    return Shared(
        is_shared, solution.reshape(scaled.shape) * scale, blocks * np.outer(scale, scale)
    )


def _agreeing_parameters(values: FloatArray, covariances: FloatArray) -> BoolArray:
    """Return which parameters agree in all regimes, each by itself, shape (P,)."""
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    safe = np.maximum(variances, np.finfo(float).tiny)
    mean = np.sum(values / safe, axis=0) / np.sum(1.0 / safe, axis=0)
    squares = np.sum((values - mean) ** 2 / safe, axis=0)
    chances = [chi2_tail(len(values) - 1.0, float(square)) for square in squares]
    return np.asarray(np.array(chances) > FALSE_DIFFERENCE)


def _design(regimes: int, is_shared: BoolArray) -> FloatArray:
    """Return the matrix from unknowns to the parameters of all regimes, shape (L P, unknowns)."""
    separate = np.flatnonzero(~is_shared)
    common = np.flatnonzero(is_shared)
    count = len(is_shared)
    design = np.zeros((regimes, count, len(common) + regimes * len(separate)))
    for number in range(regimes):
        design[number, common, np.arange(len(common))] = 1.0
        design[
            number, separate, len(common) + number * len(separate) + np.arange(len(separate))
        ] = 1.0
    return design.reshape(regimes * count, -1)

"""Maximum-likelihood amounts of known shapes in spectra.

The powers are means of exponentially distributed ones. Multiplicative updates keep the amounts
positive (Févotte, Bertin & Durrieu 2009).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrident.data.records import FloatArray

#: Multiplicative updates of the amounts …
UPDATES = 46
#: … of which so many at the beginning and the end are plain …
PLAIN_UPDATES = 4
#: … and the others take this multiple of an update and of the step before (heavy ball: Polyak
#: 1964).
RELAXATION = 1.5
MOMENTUM = 0.8
#: Largest change of a logarithm in a step.
MAX_STEP = 2.0
#: Logarithm of an amount of zero, over the mean of the spectrum.
MIN_LOGARITHM = -32.0
#: An amount of less than this fraction of the largest is at its bound.
BOUND = 1e-6
#: Ridge of an information matrix, relative: a limit of the arithmetic.
RIDGE = 1e-12
#: Lower limit of the mean of a spectrum, whose square must not vanish.
MIN_MEAN = 1e-140
#: Lower limit of levels, relative to the mean.
MIN_LEVEL = 1e-12


class Amounts(NamedTuple):
    """Amounts of S shapes in M spectra of each of G groups.

    Attributes:
        values: shape (G, M, S).
        information: Fisher's, shape (G, M, S, S), over the dispersion about the shapes where that
            exceeds chance: a poor fit makes the amounts less certain (quasi-likelihood: McCullagh &
            Nelder 1989, ch. 9).
        shares: means of what the amounts add to the level, over its mean, shape (G, M, S).
    """

    values: FloatArray
    information: FloatArray
    shares: FloatArray


def amounts_of(
    shapes: FloatArray, level: FloatArray, counts: FloatArray, known: FloatArray | float = 0.0
) -> Amounts:
    """Return the most likely amounts of shapes in levels.

    Args:
        shapes: shape (G, S, B): of G groups.
        level: shape (G, M, B): M spectra of each group.
        counts: powers behind each, shape (G, M, B).
        known: level in addition to the shapes, shape (G, M, B).
    """
    size = np.maximum(np.average(level, axis=-1, weights=counts)[..., None], MIN_MEAN)
    level = np.maximum(level / size, MIN_LEVEL)
    known = known / size
    # Amounts start equal whatever the units of the shapes.
    unit = np.maximum(np.mean(shapes, axis=-1), MIN_MEAN)
    shapes = shapes / unit[..., None]
    groups, count, bins = shapes.shape
    spectra = level.shape[1]
    shape_columns = np.ascontiguousarray(np.swapaxes(shapes, 1, 2))
    pairs = (shape_columns[..., :, None] * shape_columns[..., None, :]).reshape(
        groups, bins, count**2
    )
    weighted = counts * level
    ratios = np.empty((groups, 2 * spectra, bins))
    up = ratios[:, :spectra]
    down = ratios[:, spectra:]
    logarithm = np.full((groups, spectra, count), -np.log(count))
    step = np.zeros_like(logarithm)
    values = np.exp(logarithm)
    fitted = values @ shapes + known
    for iteration in range(UPDATES):
        np.divide(1.0, fitted, out=fitted)
        np.multiply(counts, fitted, out=down)
        np.multiply(weighted, fitted, out=up)
        up *= fitted
        sums = ratios @ shape_columns
        update = np.log(sums[:, :spectra] / sums[:, spectra:])
        if PLAIN_UPDATES <= iteration < UPDATES - PLAIN_UPDATES:
            step = np.clip(RELAXATION * update + MOMENTUM * step, -MAX_STEP, MAX_STEP)
        else:
            step = update
        logarithm = np.maximum(logarithm + step, MIN_LOGARITHM)
        values = np.exp(logarithm)
        np.matmul(values, shapes, out=fitted)
        fitted += known
    information = ((counts / fitted**2) @ pairs).reshape(groups, spectra, count, count)
    dispersion = np.sum(counts * (level / fitted - 1.0) ** 2, axis=-1) / max(bins - count, 1)
    information /= np.maximum(dispersion, 1.0)[..., None, None]
    scale = size / unit[:, None]
    product = scale[..., :, None] * scale[..., None, :]
    return Amounts(values * scale, information / product, values)


def variances_of_last(amounts: Amounts, coloured: slice) -> FloatArray:
    """Return the variance of the last amounts, shape (G, M).

    Args:
        amounts: of the shapes.
        coloured: shapes that are no unknowns at their bound: they cannot hide the others.
    """
    values = amounts.values
    fixed = np.zeros(values.shape, dtype=bool)
    shares = amounts.shares[..., coloured]
    fixed[..., coloured] = shares <= BOUND * np.max(amounts.shares, axis=-1, keepdims=True)
    free = ~fixed[..., :, None] & ~fixed[..., None, :]
    power = np.diagonal(amounts.information, axis1=-2, axis2=-1)
    diagonal = np.where(fixed, 1.0, RIDGE * power + 1e-300)[..., None] * np.eye(values.shape[-1])
    information = np.where(free, amounts.information, 0.0) + diagonal
    return np.asarray(np.linalg.inv(information), float)[..., -1, -1]

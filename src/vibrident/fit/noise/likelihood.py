"""Amounts of known shapes in spectra, by likelihood.

The powers are means of exponentially distributed ones. Multiplicative updates keep the amounts
positive (Févotte, Bertin & Durrieu 2009).
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray

#: Multiplicative updates of the amounts.
MAX_UPDATES = 150
#: Lower limit of levels, relative to the mean.
MIN_LEVEL = 1e-12


def amounts_of(
    shapes: FloatArray, level: FloatArray, counts: FloatArray, known: FloatArray | float = 0.0
) -> FloatArray:
    """Return the most likely amounts of shapes in levels, shape (G, M, S).

    Args:
        shapes: shape (G, S, B): of G groups.
        level: shape (G, M, B): M spectra of each group.
        counts: powers behind each, shape (G, M, B).
        known: what is there beside the shapes, shape (G, M, B).
    """
    size = np.average(level, axis=-1, weights=counts)[..., None]
    level = np.maximum(level / size, MIN_LEVEL)
    known = known / size
    across = np.ascontiguousarray(np.swapaxes(shapes, -1, -2))
    amounts = np.full((*level.shape[:2], shapes.shape[1]), 1.0 / shapes.shape[1])
    both = np.empty((len(level), 2 * level.shape[1], level.shape[2]))
    up, down = np.split(both, 2, axis=1)
    weighted = counts * level
    fitted = amounts @ shapes + known
    for _ in range(MAX_UPDATES):
        np.divide(1.0, fitted, out=fitted)
        np.multiply(counts, fitted, out=down)
        np.multiply(weighted, fitted, out=up)
        up *= fitted
        sums = both @ across
        amounts *= sums[:, : level.shape[1]]
        amounts /= np.maximum(sums[:, level.shape[1] :], 1e-300)
        np.matmul(amounts, shapes, out=fitted)
        fitted += known
    return amounts * size


def information_of(shapes: FloatArray, fitted: FloatArray, counts: FloatArray) -> FloatArray:
    """Return Fisher's information of amounts, shape (G, M, S, S).

    Args:
        shapes: shape (G, S, B).
        fitted: the spectra that the amounts make, shape (G, M, B).
        counts: powers behind each, shape (G, M, B).
    """
    weighted = shapes[:, None] * (counts / fitted**2)[:, :, None]
    return weighted @ np.swapaxes(shapes, -1, -2)[:, None]

"""Square-root information: what is known of the unknowns as an upper triangle R with right-hand side z, R φ = z.

The covariance (RᵀR)⁻¹ cannot lose positivity, whatever is added (Bierman 1977, ch. 5 and 6). The arrays are (m, m + 1):
R, and z in the last column. Nuisances come first, so that what they leave of the others stands in the rows below.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray

#: Part of a column that rounding leaves where others can make it: such a column tells nothing.
WITHIN = 1e-9
#: Information that stands for none about a nuisance, in units of its first block's: a limit of the arithmetic.
NONE = 1e-8
#: Information that is left of a changed parameter, in units of one over its change squared: rounding loses as many
#: digits, and the old value moves the new one by less than a hundredth of the u that shows the change.
LEFT = 1e-4


def triangle(gram: FloatArray) -> FloatArray:
    """Upper triangle U with UᵀU = ``gram``, shape (k, k); rows of columns that others can make are zero.

    The last column is the residual's: the square of its pivot is what the others leave of it.
    """
    size = len(gram)
    left, upper = gram.copy(), np.zeros_like(gram)
    for k in range(size):
        pivot = left[k, k]
        if pivot > WITHIN * gram[k, k] or (k == size - 1 and pivot > 0.0):
            row = left[k, k:] / np.sqrt(pivot)
            upper[k, k:] = row
            left[k:, k:] -= row[:, None] * row
    return upper


def absorb(known: FloatArray, rows: FloatArray) -> FloatArray:
    """What is known together with further rows, shape (rows, m + 1)."""
    return reduced(np.concatenate([known, rows]))[: len(known)]


def reduced(rows: FloatArray) -> FloatArray:
    """Upper triangle R with RᵀR = rowsᵀ rows; its diagonal is not negative."""
    found = np.asarray(np.linalg.qr(rows, mode="r"))
    return found * np.where(np.diag(found) < 0.0, -1.0, 1.0)[:, None]


def walk(known: FloatArray, variance: FloatArray, first: int) -> FloatArray:
    """What is known after the unknowns from ``first`` on have moved by random steps of these variances, shape (p,)."""
    moving = np.flatnonzero(variance > 0.0)
    if not moving.size:
        return known
    m, w = known.shape[0], moving.size
    stacked = np.zeros((m + w, w + m + 1))
    stacked[:w, :w] = np.diag(1.0 / np.sqrt(variance[moving]))
    stacked[w:, :w] = -known[:, first + moving]
    stacked[w:, w:] = known
    return reduced(stacked)[w : w + m, w:]


def solve(known: FloatArray) -> FloatArray:
    """The unknowns, shape (m,); zero where nothing is known."""
    m = known.shape[0]
    found = np.zeros(m)
    for k in range(m - 1, -1, -1):
        if known[k, k] > 0.0:
            found[k] = (known[k, m] - known[k, k + 1 : m] @ found[k + 1 :]) / known[k, k]
    return found


def covariance(known: FloatArray, first: int) -> FloatArray:
    """Covariance of the unknowns from ``first`` on; infinite variance where nothing is known."""
    r = known[first:, first:-1]
    seen = np.diag(r) > 0.0
    found = np.diag(np.where(seen, 0.0, np.inf))
    inverse = np.linalg.inv(r[np.ix_(seen, seen)])
    found[np.ix_(seen, seen)] = inverse @ inverse.T
    return found


def shifted(gram: FloatArray, move: FloatArray) -> FloatArray:
    """Products of rows, shape (…, m + 1, m + 1), with the residual as it is after the unknowns have moved."""
    change = np.eye(gram.shape[-1])
    change[:-1, -1] = -move
    return change.T @ gram @ change


def without_nuisances(gram: FloatArray, nuisances: int) -> FloatArray:
    """Products of rows with the nuisances projected out and left unknown."""
    upper = triangle(gram)
    upper[:nuisances] = 0.0
    return upper.T @ upper

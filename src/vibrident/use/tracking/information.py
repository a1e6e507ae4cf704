"""Square-root information: the knowledge of the unknowns φ as R φ = z, with an upper triangle R.

The covariance (RᵀR)⁻¹ stays positive whatever is added (Bierman 1977, ch. 5 and 6). The arrays have
shape (m, m + 1): R, and z in the last column. Nuisances come first, so that the rows below theirs
hold the information about the parameters with the nuisances unknown.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray

#: Part of a column that must be independent of the columns before it; less is rounding.
MIN_INDEPENDENT_PART = 1e-9
#: Information about an unknown nuisance, in units of that of its first block: a limit of the
#: arithmetic.
INITIAL_INFORMATION = 1e-8
#: Information retained about a changed parameter, in units of one over its change squared: rounding
#: loses as many digits, and the old value moves the new one by less than a hundredth of the u that
#: shows the change.
RETAINED_INFORMATION = 1e-4


def triangle(gram: FloatArray) -> FloatArray:
    """Return the upper triangle U with UᵀU = ``gram``, shape (k, k).

    Rows of columns that depend on earlier ones are zero. The last column is the residual's: the
    square of its pivot is the sum of squares that the other columns do not explain.
    """
    size = len(gram)
    remaining = gram.copy()
    upper = np.zeros_like(gram)
    for k in range(size):
        pivot = remaining[k, k]
        if pivot > MIN_INDEPENDENT_PART * gram[k, k] or (k == size - 1 and pivot > 0.0):
            row = remaining[k, k:] / np.sqrt(pivot)
            upper[k, k:] = row
            remaining[k:, k:] -= row[:, None] * row
    return upper


def absorb(root: FloatArray, rows: FloatArray) -> FloatArray:
    """Return the information with further rows added, shape (m, m + 1).

    ``rows``: shape (rows, m + 1).
    """
    return reduced(np.concatenate([root, rows]))[: len(root)]


def reduced(rows: FloatArray) -> FloatArray:
    """Return the upper triangle R with RᵀR = rowsᵀ rows, its diagonal not negative."""
    upper = np.asarray(np.linalg.qr(rows, mode="r"))
    return upper * np.where(np.diag(upper) < 0.0, -1.0, 1.0)[:, None]


def walk(root: FloatArray, variance: FloatArray, first: int) -> FloatArray:
    """Return the information after random steps of the unknowns from ``first`` on.

    ``variance``: of the steps, shape (p,).
    """
    moving = np.flatnonzero(variance > 0.0)
    if not moving.size:
        return root
    m = root.shape[0]
    w = moving.size
    stacked = np.zeros((m + w, w + m + 1))
    stacked[:w, :w] = np.diag(1.0 / np.sqrt(variance[moving]))
    stacked[w:, :w] = -root[:, first + moving]
    stacked[w:, w:] = root
    return reduced(stacked)[w : w + m, w:]


def solve(root: FloatArray) -> FloatArray:
    """Return the unknowns, shape (m,); zero where nothing is known."""
    m = root.shape[0]
    unknowns = np.zeros(m)
    for k in range(m - 1, -1, -1):
        if root[k, k] > 0.0:
            unknowns[k] = (root[k, m] - root[k, k + 1 : m] @ unknowns[k + 1 :]) / root[k, k]
    return unknowns


def covariance(root: FloatArray, first: int) -> FloatArray:
    """Return the covariance of the unknowns from ``first`` on.

    The variance is infinite where nothing is known.
    """
    r = root[first:, first:-1]
    informed = np.diag(r) > 0.0
    matrix = np.diag(np.where(informed, 0.0, np.inf))
    inverse = np.linalg.inv(r[np.ix_(informed, informed)])
    matrix[np.ix_(informed, informed)] = inverse @ inverse.T
    return matrix


def shifted(gram: FloatArray, move: FloatArray) -> FloatArray:
    """Return products of rows after the unknowns moved, shape (…, m + 1, m + 1).

    The residual, in the last column, is that at the moved point.
    """
    change = np.eye(gram.shape[-1])
    change[:-1, -1] = -move
    return change.T @ gram @ change


def without_nuisances(gram: FloatArray, nuisances: int) -> FloatArray:
    """Return products of rows with the nuisances projected out and unknown."""
    upper = triangle(gram)
    upper[:nuisances] = 0.0
    return upper.T @ upper

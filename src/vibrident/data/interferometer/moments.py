"""Sums of powers of two signals up to the fourth degree: sufficient for an ellipse fit to any number of samples.

Of samples with Gaussian noise of covariance C, ``without_noise`` gives the sums that are expected
of the samples without noise, exactly: exp(−½ ∇ᵀC∇) is applied to the monomials (Hermite
polynomials). A fit to them is consistent (Kukush, Markovsky & Van Huffel 2004, "Consistent
estimation in an implicit quadratic measurement error model").
"""

from __future__ import annotations

import numpy as np

from vibrident.data.interferometer.setting import FloatArray

AT_ONCE = 1 << 13  # samples in a product: few enough for the processor's cache
POWERS = (
    (0, 0),
    (1, 0),
    (0, 1),
    (2, 0),
    (1, 1),
    (0, 2),
)  # powers of x and y of the six functions 1, x, y, x², xy, y²


def sums(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return Σ x^a y^b for a + b ≤ 4, shape (5, 5), zero elsewhere; x and y of shape (n,)."""
    total = np.zeros((6, 6))
    for start in range(0, x.shape[0], AT_ONCE):
        first = x[start : start + AT_ONCE]
        second = y[start : start + AT_ONCE]
        functions = np.empty((6, first.shape[0]))
        functions[0] = 1.0
        functions[1] = first
        functions[2] = second
        np.multiply(first, functions[1:3], out=functions[3:5])
        np.multiply(second, second, out=functions[5])
        total += functions @ functions.T
    return from_matrix(total)


def from_matrix(matrix: FloatArray) -> FloatArray:
    """Return the sums as (5, 5) from the 6 × 6 matrix of products of the six functions."""
    found = np.zeros((5, 5))
    for i, (a, b) in enumerate(POWERS):
        for j, (c, d) in enumerate(POWERS):
            found[a + c, b + d] = matrix[i, j]
    return found


def matrix(found: FloatArray) -> FloatArray:
    """Return the 6 × 6 matrix of products of the six functions from the sums, shape (5, 5)."""
    return np.array([[found[a + c, b + d] for c, d in POWERS] for a, b in POWERS])


def without_noise(found: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the expected sums of the samples without noise.

    ``found``: shape (5, 5); ``noise``: covariance of the noise of a sample, shape (2, 2).
    """
    once = _step(found, noise)
    return found + once + 0.5 * _step(once, noise)


def _step(found: FloatArray, noise: FloatArray) -> FloatArray:
    result = np.zeros((5, 5))
    for a in range(5):
        for b in range(5 - a):
            if a >= 2:
                result[a, b] -= 0.5 * noise[0, 0] * a * (a - 1) * found[a - 2, b]
            if a >= 1 and b >= 1:
                result[a, b] -= noise[0, 1] * a * b * found[a - 1, b - 1]
            if b >= 2:
                result[a, b] -= 0.5 * noise[1, 1] * b * (b - 1) * found[a, b - 2]
    return result


def moved(centre: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return the effect of a change of coordinates on the six functions, shape (6, 6): f(v) = T f(u), v = inverse (u − centre)."""
    shift = -inverse @ centre
    lines = [np.array([shift[i], inverse[i, 0], inverse[i, 1], 0.0, 0.0, 0.0]) for i in range(2)]
    one = np.eye(6)[0]
    return np.array(
        [one, *lines, _product(lines[0], lines[0]), _product(*lines), _product(lines[1], lines[1])]
    )


def _product(first: FloatArray, second: FloatArray) -> FloatArray:
    c, a, b = first[:3]
    f, d, e = second[:3]
    return np.array([c * f, a * f + c * d, b * f + c * e, a * d, a * e + b * d, b * e])

"""Sum powers of two signals up to the fourth degree: sufficient statistics of an ellipse fit.

Of samples with Gaussian noise of covariance C, here diagonal, ``without_noise`` gives the sums that
are expected of the samples without noise, exactly: exp(−½ ∇ᵀC∇) is applied to the monomials
(Hermite polynomials). A fit to them is consistent (Kukush, Markovsky & Van Huffel 2004, "Consistent
estimation in an implicit quadratic measurement error model").
"""

from __future__ import annotations

import numpy as np

from vibrident.data.interferometer.setting import FloatArray

BLOCK_SAMPLES = 1 << 13  # samples in a product: few enough for the processor's cache
# powers of x and y of the six functions 1, x, y, x², xy, y²
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
#: −½ of the second derivative of x^a, as a factor of x^(a − 2).
_CURVATURE = np.diag([-1.0, -3.0, -6.0], -2)


def sums(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return Σ x^a y^b for a + b ≤ 4, shape (5, 5), zero elsewhere.

    ``x`` and ``y`` have shape (n,).
    """
    total = np.zeros((6, 6))
    for start in range(0, x.shape[0], BLOCK_SAMPLES):
        first = x[start : start + BLOCK_SAMPLES]
        second = y[start : start + BLOCK_SAMPLES]
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
    total = np.zeros((5, 5))
    for i, (a, b) in enumerate(POWERS):
        for j, (c, d) in enumerate(POWERS):
            total[a + c, b + d] = matrix[i, j]
    return total


def matrix(total: FloatArray) -> FloatArray:
    """Return the 6 × 6 matrix of products of the six functions from the sums, shape (5, 5)."""
    return np.array([[total[a + c, b + d] for c, d in POWERS] for a, b in POWERS])


def without_noise(total: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the expected sums of the samples without noise.

    Args:
        total: sums, shape (5, 5).
        noise: variances of the noise of both signals, shape (2,).
    """
    correction = _noise_correction(total, noise)
    return total + correction + 0.5 * _noise_correction(correction, noise)


def _noise_correction(total: FloatArray, noise: FloatArray) -> FloatArray:
    """Return −½ ∇ᵀC∇ of the sums; those above the fourth degree have no meaning."""
    first, second = (variance * _CURVATURE for variance in noise)
    return first @ total + total @ second.T


def change_of_coordinates(centre: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return the matrix T of the six functions, f(v) = T f(u), for v = inverse (u − centre).

    Shape (6, 6).
    """
    shift = -inverse @ centre
    lines = [np.array([shift[i], inverse[i, 0], inverse[i, 1], 0.0, 0.0, 0.0]) for i in range(2)]
    constant = np.eye(6)[0]
    return np.array(
        [
            constant,
            *lines,
            _product(lines[0], lines[0]),
            _product(*lines),
            _product(lines[1], lines[1]),
        ]
    )


def _product(first: FloatArray, second: FloatArray) -> FloatArray:
    c, a, b = first[:3]
    f, d, e = second[:3]
    return np.array([c * f, a * f + c * d, b * f + c * e, a * d, a * e + b * d, b * e])

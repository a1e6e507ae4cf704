"""Inverses of normal matrices JᵀJ, and what they say of a direction that the data leave open."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray

SMALLEST = (
    1e-12  # scaled eigenvalues below this are rounding: the direction is not determined at all
)
NONE = (
    1e-70  # information that counts as none: small enough to say so, large enough not to overflow
)


def inverse_normal(matrix: FloatArray) -> FloatArray:
    """Inverse of normal matrices, shape (…, p, p).

    A direction without information gets a very large variance, where a pseudo-inverse would give it none: a parameter
    that the data cannot tell must not look certain.
    """
    root = inverse_root(matrix)
    return root @ np.swapaxes(root, -1, -2)


def inverse_root(matrix: FloatArray) -> FloatArray:
    """L, shape (…, p, p), of the inverse L Lᵀ of normal matrices; as :func:`inverse_normal`."""
    power = np.diagonal(matrix, axis1=-2, axis2=-1)
    scale = np.maximum(np.sqrt(np.maximum(power, 0.0)), NONE)
    values, vectors = np.linalg.eigh(matrix / scale[..., :, None] / scale[..., None, :])
    root = vectors / np.sqrt(np.maximum(values, SMALLEST))[..., None, :]
    return np.asarray(root / scale[..., :, None])


def sandwich_covariance(
    root: FloatArray, middle: FloatArray, information: FloatArray
) -> FloatArray:
    """L Lᵀ M L Lᵀ for L Lᵀ, the inverse of the information, and M, the covariance of the gradient; shape (p, p).

    A direction whose information is lost in rounding has a gradient lost in rounding too, which says nothing: its
    variance is that of L Lᵀ. So it is where less than half of the information that L Lᵀ stands for is there. No
    variance is negative.
    """
    middle = root.T @ middle @ root
    lost = np.diag(root.T @ information @ root) < 0.5
    middle[lost], middle[:, lost] = 0.0, 0.0
    values, vectors = np.linalg.eigh(middle + np.diag(lost.astype(float)))
    half = root @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    return half @ half.T


def inverse_where_shown(matrices: FloatArray, least: float = SMALLEST) -> FloatArray:
    """Inverse of normal matrices of numbers that are taken out, shape (…, n, n).

    Zero along directions that the data show less than ``least`` of the best: what several numbers can imitate alike is
    left to one of them. So is a number that has next to nothing of its own, as a decay that is over.
    """
    power = np.diagonal(matrices, axis1=-2, axis2=-1)
    some = power > NONE * np.max(power, axis=-1, keepdims=True, initial=0.0)
    size = np.where(some, np.sqrt(np.where(some, power, 1.0)), np.inf)
    both = size[..., :, None] * size[..., None, :]
    scaled = matrices / both
    inverse, regular = regular_inverse(scaled, least)
    if not np.all(regular):
        values, vectors = np.linalg.eigh(scaled[~regular])
        kept = np.where(values > least, 1.0 / np.maximum(values, least), 0.0)
        inverse[~regular] = (vectors * kept[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return inverse / both


def regular_inverse(matrices: NDArray[Any], least: float) -> tuple[NDArray[Any], BoolArray]:
    """Return inverses of Hermitian matrices, and where all eigenvalues are surely above a limit.

    No eigenvalue is below one over the norm of the inverse. Elimination takes a fifth of the time of eigenvalues.

    Args:
        matrices: shape (…, n, n).
        least: the limit.

    Returns:
        Shapes (…, n, n) and (…); elsewhere inverses mean nothing.
    """
    try:
        inverse = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:  # one of them is singular
        return np.empty_like(matrices), np.zeros(matrices.shape[:-2], dtype=bool)
    squares = np.sum(inverse.real**2 + inverse.imag**2, axis=(-2, -1))
    return inverse, squares < least**-2.0

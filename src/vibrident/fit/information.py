"""Inverses of normal matrices JᵀJ, and what they say of a direction that the data leave open."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray

#: Scaled eigenvalues below this are rounding: the direction is not determined at all.
MIN_SCALED_EIGENVALUE = 1e-12
#: Information that counts as none: small enough to say so, large enough not to overflow.
NO_INFORMATION = 1e-70


def inverse_normal(matrix: FloatArray) -> FloatArray:
    """Return the inverse of normal matrices, shape (…, p, p).

    A direction without information gets a very large variance, where a pseudo-inverse would give it
    none: a parameter that the data cannot tell must not look certain.
    """
    root = inverse_root(matrix)
    return root @ np.swapaxes(root, -1, -2)


def inverse_root(matrix: FloatArray) -> FloatArray:
    """Return L, shape (…, p, p), of the inverse L Lᵀ of normal matrices.

    Directions without information are as for :func:`inverse_normal`.
    """
    power = np.diagonal(matrix, axis1=-2, axis2=-1)
    scale = np.maximum(np.sqrt(np.maximum(power, 0.0)), NO_INFORMATION)
    values, vectors = np.linalg.eigh(matrix / scale[..., :, None] / scale[..., None, :])
    root = vectors / np.sqrt(np.maximum(values, MIN_SCALED_EIGENVALUE))[..., None, :]
    return np.asarray(root / scale[..., :, None])


def laplace_score(cost: Any, matrix: FloatArray) -> Any:
    """Return −2 log of the likelihood of data over all parameters, by Laplace's approximation.

    A mode of hardly any width or size follows a line of the noise, and fits better than the right
    one that shows by its tail alone. Of all places, widths and sizes that it could have, only one
    does so.

    Args:
        cost: weighted sums of squares at the best parameters, shape (…).
        matrix: JᵀWJ by coordinates whose prior width is one, shape (…, p, p).
    """
    occam = np.linalg.slogdet(np.eye(matrix.shape[-1]) + matrix)[1]
    return cost + np.where(np.isfinite(occam), occam, 0.0)


def sandwich_covariance(
    root: FloatArray, middle: FloatArray, information: FloatArray
) -> FloatArray:
    """Return L Lᵀ M L Lᵀ, the covariance by the gradient's, shape (p, p).

    L Lᵀ is the inverse of the information, and M the covariance of the gradient. A direction whose
    information is lost in rounding has a gradient lost in rounding too, which says nothing: its
    variance is that of L Lᵀ. So it is where less than half of the information that L Lᵀ stands for
    is there. No variance is negative.

    Args:
        root: L, shape (p, p).
        middle: M, shape (p, p).
        information: shape (p, p).
    """
    middle = root.T @ middle @ root
    unsupported = np.diag(root.T @ information @ root) < 0.5
    middle[unsupported] = 0.0
    middle[:, unsupported] = 0.0
    values, vectors = np.linalg.eigh(middle + np.diag(unsupported.astype(float)))
    half_root = root @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    return half_root @ half_root.T


def inverse_where_shown(matrices: FloatArray, least: float = MIN_SCALED_EIGENVALUE) -> FloatArray:
    """Return the inverse of normal matrices of numbers that are taken out, shape (…, n, n).

    It is zero along directions that the data show less than ``least`` of the best: what several
    numbers can imitate alike is left to one of them. So is a number that has next to nothing of its
    own, as a decay that is over.
    """
    power = np.diagonal(matrices, axis1=-2, axis2=-1)
    shown = power > NO_INFORMATION * np.max(power, axis=-1, keepdims=True, initial=0.0)
    scale = np.where(shown, np.sqrt(np.where(shown, power, 1.0)), np.inf)
    scale_products = scale[..., :, None] * scale[..., None, :]
    scaled = matrices / scale_products
    inverse, regular = regular_inverse(scaled, least)
    if not np.all(regular):
        values, vectors = np.linalg.eigh(scaled[~regular])
        reciprocals = np.where(values > least, 1.0 / np.maximum(values, least), 0.0)
        inverse[~regular] = (vectors * reciprocals[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return inverse / scale_products


def regular_inverse(matrices: NDArray[Any], least: float) -> tuple[NDArray[Any], BoolArray]:
    """Return inverses of Hermitian matrices, and where all eigenvalues are surely above a limit.

    No eigenvalue is below one over the norm of the inverse. Elimination takes a fifth of the time
    of eigenvalues.

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

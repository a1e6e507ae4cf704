"""Whitened rows of records: projections, orthonormal bases, and their signals in time."""

from __future__ import annotations

import numpy as np
from numpy import fft

from vibrident.data.records import FloatArray
from vibrident.fit.response.response import ComplexArray

#: Rounding of columns that others span, in squares.
ROUNDING = 1e-13
#: Rounding of what remains of rows that others span, in squares.
LOST = 1e-12


def without(rows: FloatArray, basis: FloatArray) -> FloatArray:
    """Return rows, shape (R, m, i), less their projections on orthonormal ones.

    Rows of which only rounding remains are zero.
    """
    remainder = rows - (rows @ basis.mT) @ basis
    remainder[
        np.einsum("rmi,rmi->rm", remainder, remainder)
        <= LOST * np.einsum("rmi,rmi->rm", rows, rows)
    ] = 0.0
    return remainder


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return orthonormal rows that span columns, each of shape (R, m, i).

    They are zero where columns depend on each other.
    """
    size = np.sqrt(np.einsum("rmi,rmi->rm", columns, columns))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    gram = (columns @ columns.mT) * scale[..., None] * scale[..., None, :]
    values, vectors = np.linalg.eigh(gram)
    independent = values > ROUNDING * np.maximum(values[..., -1:], 1e-300)
    scales = np.divide(
        1.0, np.sqrt(np.maximum(values, 1e-300)), out=np.zeros_like(values), where=independent
    )
    return (vectors * scales[..., None, :]).mT * scale[..., None, :] @ columns


def rank_of(basis: FloatArray) -> FloatArray:
    """Return the number of rows that are not zero, shape (R,)."""
    return np.sum(np.einsum("rmi,rmi->rm", basis, basis) > 0.5, axis=1).astype(float)


def in_time(bins: ComplexArray, length: int) -> FloatArray:
    """Return signals of so many samples from their bins, of which zero is left out."""
    padded = np.zeros((*bins.shape[:-1], bins.shape[-1] + 1), dtype=complex)
    padded[..., 1:] = bins
    return np.asarray(fft.irfft(padded, length, axis=-1), dtype=float)

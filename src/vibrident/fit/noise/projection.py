"""Projection of signals onto the complement of what is locally coherent with motions.

In each block of bins a quadratic in frequency times each motion is projected out of the signal, as
any linear sensor's response to it is nearly that (local polynomial method: Pintelon & Schoukens
2012, ch. 7). All products of columns are moments of few products of motions, so that a block costs
few operations.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.group.network import Nuisances
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: Bins of a block.
BLOCK_BINS = 24
#: Most blocks that are processed at once: their matrices stay in the cache.
MAX_BLOCKS = 1400
#: Polynomials of a block: a constant, a line and a parabola.
DEGREES = 3
#: Ridge of the projection, relative: a limit of the arithmetic.
RIDGE = 1e-9


class _PolynomialBasis(NamedTuple):
    """Orthonormal polynomials over a block.

    Attributes:
        moments: of degrees 0 to 4, shape (5, w).
        products: of pairs of degrees 0 to 2 in those, shape (3, 3, 5).
    """

    moments: FloatArray
    products: FloatArray


@functools.lru_cache(maxsize=8)
def _basis(width: int) -> _PolynomialBasis:
    """Return the polynomials over blocks of so many bins.

    Of fewer bins than degrees those of higher degrees are zero.
    """
    powers = np.linspace(-1.0, 1.0, width)[:, None] ** np.arange(2 * DEGREES - 1)
    orthonormal = np.linalg.qr(powers)[0].T
    moments = np.zeros(powers.T.shape)
    moments[: len(orthonormal)] = orthonormal
    pairs = moments[:DEGREES, None] * moments[None, :DEGREES]
    return _PolynomialBasis(moments, pairs @ moments.T)


def polynomials_of(width: int) -> FloatArray:
    """Return orthonormal polynomials over a block of so many bins, shape (3, w)."""
    return _basis(width).moments[:DEGREES]


def block_edges(bins: int) -> NDArray[np.int_]:
    """Return the first bins of blocks, from bin 1 on, and the bin after the last full one."""
    width = -(-(bins - 1) // max((bins - 1) // BLOCK_BINS, 1))
    return 1 + width * np.arange(-(-(bins - 1) // width) + 1)


def without_common(
    rows: ComplexArray,
    motions: Sequence[ComplexArray],
    root: FloatArray,
    heard: BoolArray | None = None,
    free_motion: ComplexArray | None = None,
) -> tuple[ComplexArray, FloatArray]:
    """Return rows without the component that is locally coherent with motions.

    Args:
        rows: shape (R, K); bin 0 does not count.
        motions: each of shape (R, K) or (1, K).
        root: of the level of the noise of the rows, shape (R, K).
        heard: where there is motion, shape (R, K); None: everywhere.
        free_motion: m columns over all bins, whose real amounts are fitted at the same time, shape
            (R or 1, m, K); None: none.

    Returns:
        The remainder, shape (R, K), and its degrees of freedom, 0 … 1 a bin, shape (R, K): noise of
            power S leaves S times that there.
    """
    records, bins = rows.shape
    edges = block_edges(bins)
    width = edges[1] - edges[0]
    inverse = 1.0 / root[:, 1:]

    def in_blocks(signal: ComplexArray, weight: FloatArray) -> ComplexArray:
        padded = np.empty((records, width * (len(edges) - 1)), complex)
        np.multiply(signal[:, 1:], weight, out=padded[:, : bins - 1])
        padded[:, bins - 1 :] = 0.0
        return padded.reshape(-1, width)

    weight = inverse if heard is None else inverse * heard[:, 1:]
    columns = LocalColumns.from_motions([in_blocks(motion, weight) for motion in motions])

    def beside_columns(signal: ComplexArray) -> ComplexArray:
        blocks = in_blocks(signal, inverse)
        return (blocks - columns.explained(blocks)).reshape(records, -1)[:, : bins - 1]

    whitened = beside_columns(rows)
    if free_motion is not None:
        parts = [beside_columns(column) for column in np.moveaxis(free_motion, 1, 0)]
        free = Nuisances.in_weight(np.stack(parts, axis=1), np.ones((1, bins - 1)))
        whitened -= free.imitated(whitened[:, None])[:, 0]
    remainder = rows.copy()
    remainder[:, 1:] = whitened * root[:, 1:]
    freedom = np.ones(rows.shape)
    freedom[:, 1:] -= columns.leverage().reshape(records, -1)[:, : bins - 1]
    return remainder, np.clip(freedom, 0.0, 1.0, out=freedom)


@dataclass(frozen=True, eq=False)
class LocalColumns:
    """Polynomials times each of M motions, in N blocks of w bins, and what these explain.

    Attributes:
        motions: at mean power one in each block, or zero, shape (N, w) each.
        inverse: of the products of the columns, shape (3 M, 3 M, N).
        count: number of columns that are independent, shape (N,).
    """

    motions: list[ComplexArray]
    inverse: ComplexArray
    count: FloatArray

    @classmethod
    def from_motions(cls, motions: Sequence[ComplexArray]) -> LocalColumns:
        """Return the columns of motions, which are scaled in place."""
        units = [_unit(motion) for motion in motions]
        blocks, width = units[0].shape
        moments, products = _basis(width)
        table = products.reshape(-1, 2 * DEGREES - 1)
        count = len(units)
        gram = np.empty((count, DEGREES, count, DEGREES, blocks), complex)
        for i, j, batch, pair in _pairs(units):
            block = (table @ (pair @ moments.T).T).reshape(DEGREES, DEGREES, -1)
            gram[i, :, j, :, batch] = block
            gram[j, :, i, :, batch] = block.conj()
        gram = gram.reshape(DEGREES * count, DEGREES * count, -1)
        inverse = _inverses(gram)
        # G⁻¹ is of G and a ridge: its trace is what the ridge takes.
        diagonal = np.einsum("iin->n", inverse).real
        return cls(units, inverse, DEGREES * count - RIDGE * diagonal)

    def explained(self, rows: ComplexArray) -> ComplexArray:
        """Return the projection of rows onto the columns, shape (N, w)."""
        polynomials = polynomials_of(rows.shape[1])
        explained = np.empty_like(rows)
        for batch in _batches(len(rows)):
            motions = [motion[batch] for motion in self.motions]
            common = [(polynomials @ (motion.conj() * rows[batch]).T) for motion in motions]
            amounts = np.einsum("ijn,jn->in", self.inverse[..., batch], np.concatenate(common))
            total = np.zeros_like(motions[0])
            for number, motion in enumerate(motions):
                of_motion = amounts[DEGREES * number : DEGREES * (number + 1)]
                total += (of_motion.T @ polynomials) * motion
            explained[batch] = total
        return explained

    def leverage(self) -> FloatArray:
        """Return the share of noise that the columns take at each bin, shape (N, w)."""
        blocks, width = self.motions[0].shape
        moments, products = _basis(width)
        table = products.reshape(-1, 2 * DEGREES - 1)
        count = len(self.motions)
        inverse = self.inverse.reshape(count, DEGREES, count, DEGREES, blocks)
        leverage = np.zeros((blocks, width))
        for i, j, batch, pair in _pairs(self.motions):
            share = (table.T @ inverse[i, :, j, :, batch].reshape(DEGREES**2, -1)).T
            if i == j:
                leverage[batch] += (share.real @ moments) * pair
            else:  # h = Σ m_i A_ij m_j*, and the pair is m_i* m_j
                curve = share @ moments
                leverage[batch] += 2.0 * (curve.real * pair.real + curve.imag * pair.imag)
        return leverage


def _batches(blocks: int) -> list[slice]:
    """Return slices of blocks whose matrices stay in the cache."""
    return [slice(begin, begin + MAX_BLOCKS) for begin in range(0, blocks, MAX_BLOCKS)]


def _pairs(
    motions: Sequence[ComplexArray],
) -> Iterator[tuple[int, int, slice, ComplexArray | FloatArray]]:
    """Yield the products of the conjugate of each motion with itself and each later one."""
    for batch in _batches(len(motions[0])):
        for i, first in enumerate(motions):
            yield i, i, batch, power_of(first[batch])
            adjoint = first[batch].conj()
            for j in range(i + 1, len(motions)):
                yield i, j, batch, adjoint * motions[j][batch]


def _unit(motion: ComplexArray) -> ComplexArray:
    """Return the motion of each block at mean power one, or zero, shape (N, w); in place."""
    size = np.sqrt(np.mean(power_of(motion), axis=1, keepdims=True))
    motion *= np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    return motion


def _inverses(gram: ComplexArray) -> ComplexArray:
    """Return the inverses of Hermitian matrices, shape (m, m, N), by Cholesky factors."""
    size = len(gram)
    factor = np.zeros_like(gram)
    root = np.zeros_like(gram)
    for i in range(size):
        gram[i, i] += RIDGE
        column = gram[i:, i] - np.einsum("ikn,kn->in", factor[i:, :i], factor[i, :i].conj())
        scale = 1.0 / np.sqrt(np.maximum(column[0].real, 0.5 * RIDGE))
        factor[i:, i] = column * scale
        root[i, i] = scale
        root[i, :i] = -scale * np.einsum("kn,kjn->jn", factor[i, :i], root[:i, :i])
    inverse = np.empty_like(gram)
    for i in range(size):
        row = np.einsum("kn,kjn->jn", root[i:, i].conj(), root[i:, : i + 1])
        inverse[i, : i + 1] = row
        inverse[:i, i] = row[:i].conj()
    return inverse

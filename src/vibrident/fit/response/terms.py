"""Terms of the fit of a sine record: exponentials, offset and trend, without a table of each.

A sum over N samples with an exponential e^{pk} needs no table of N values: k = W i + j makes it a
product of two tables of about √N values, and all exponentials together one product of matrices.
Sums of exponentials alone are geometric.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.fit.information import inverse_where_shown

#: Terms are separable where their scaled normal matrix has eigenvalues above this.
MIN_SCALED_EIGENVALUE = 1e-10


class Terms(Protocol):
    """R real terms over the n samples of a span."""

    @property
    def gram(self) -> FloatArray:
        """Return their products with each other, shape (R, R)."""
        ...

    def products(self, values: FloatArray) -> FloatArray:
        """Return their products with a series, shape (n,) → (R,)."""
        ...

    def sum(self, amounts: FloatArray) -> FloatArray:
        """Return the sum of the terms in these amounts, shape (R,) → (n,)."""
        ...

    def only(self, indices: NDArray[np.int_]) -> Terms:
        """Return the terms at these indices."""
        ...


@dataclass(frozen=True, eq=False)
class TermTable:
    """Table of terms sample by sample, zero where samples are not used.

    Attributes:
        rows: shape (R, n).
        gram: their products with each other, shape (R, R).
    """

    rows: FloatArray
    gram: FloatArray

    @classmethod
    def of(cls, rows: FloatArray) -> TermTable:
        """Return the terms of these rows, shape (R, n)."""
        return cls(rows, rows @ rows.T)

    def products(self, values: FloatArray) -> FloatArray:
        """Return the products of the terms with a series, shape (n,) → (R,)."""
        return self.rows @ values

    def sum(self, amounts: FloatArray) -> FloatArray:
        """Return the sum of the terms in these amounts, shape (R,) → (n,)."""
        return amounts @ self.rows

    def only(self, indices: NDArray[np.int_]) -> TermTable:
        """Return the terms at these indices."""
        return TermTable(self.rows[indices], self.gram[np.ix_(indices, indices)])


@dataclass(frozen=True, eq=False)
class Exponentials:
    """Real and imaginary parts of K exponentials e^{pk}, one, and a trend, over gapless samples.

    Attributes:
        steps: Re, then Im, of e^{pj}, j = 0 … W − 1, shape (2 K, W).
        begins: e^{p(first + W i)}, shape (blocks, K).
        trend: shape (n,).
        order: indices of the terms in use among Re …, Im …, one, trend, shape (R,).
        gram: products of the terms in use with each other, shape (R, R).
    """

    steps: FloatArray
    begins: NDArray[np.complex128]
    trend: FloatArray
    order: NDArray[np.int_]
    gram: FloatArray

    @classmethod
    def of(
        cls,
        exponents: NDArray[np.complex128],
        first: int,
        trend: FloatArray,
        order: NDArray[np.int_],
    ) -> Exponentials:
        """Return the terms over the samples of the trend, of indices ``first`` is the first.

        Args:
            exponents: p, shape (K,).
            first: number of the first sample.
            trend: shape (n,).
            order: indices of the terms in use, shape (R,).
        """
        steps, begins = _tables(exponents, first, trend.size)
        without_gram = cls(steps, begins, trend, order, np.zeros((0, 0)))
        gram = _gram(exponents, first, trend, without_gram._all_products(trend))
        return cls(steps, begins, trend, order, gram[np.ix_(order, order)])

    def _all_products(self, values: FloatArray) -> FloatArray:
        """Return the products of all terms, used or not, with a series, shape (n,) → (2 K + 2,)."""
        sums = _exponential_products(values, self.steps, self.begins)
        return np.concatenate([sums.real, sums.imag, [np.sum(values), self.trend @ values]])

    def products(self, values: FloatArray) -> FloatArray:
        """Return the products of the terms with a series, shape (n,) → (R,)."""
        return self._all_products(values)[self.order]

    def sum(self, amounts: FloatArray) -> FloatArray:
        """Return the sum of the terms in these amounts, shape (R,) → (n,)."""
        count = self.begins.shape[1]
        all_amounts = np.zeros(2 * count + 2)
        all_amounts[self.order] = amounts
        complex_amounts = all_amounts[:count] - 1j * all_amounts[count:-2]
        series = _exponential_sum(complex_amounts, self.steps, self.begins)[: self.trend.size]
        series += all_amounts[-2]
        series += all_amounts[-1] * self.trend
        return series

    def only(self, indices: NDArray[np.int_]) -> Exponentials:
        """Return the terms at these indices."""
        gram = self.gram[np.ix_(indices, indices)]
        return Exponentials(self.steps, self.begins, self.trend, self.order[indices], gram)


def products(
    values: FloatArray, exponents: NDArray[np.complex128], first: int = 0
) -> NDArray[np.complex128]:
    """Return Σ values e^{pk} over the samples k from ``first`` on, shape (K,).

    Args:
        values: shape (n,).
        exponents: p, shape (K,).
        first: number of the first sample.
    """
    return _exponential_products(values, *_tables(exponents, first, values.size))


def _exponential_sum(
    amounts: NDArray[np.complex128], steps: FloatArray, begins: NDArray[np.complex128]
) -> FloatArray:
    """Return the real part of Σ amount e^{pk} at all samples of the blocks."""
    blocks = begins * amounts
    return (np.concatenate([blocks.real, -blocks.imag], axis=1) @ steps).ravel()


def _tables(
    exponents: NDArray[np.complex128], first: int, samples: int
) -> tuple[FloatArray, NDArray[np.complex128]]:
    """Return the tables ``steps`` and ``begins`` of :class:`Exponentials` for so many samples."""
    width = max(int(np.sqrt(samples)), 1)
    steps: NDArray[np.complex128] = np.asarray(
        np.exp(exponents[:, None] * np.arange(width)), dtype=complex
    )
    begins = np.exp((first + width * np.arange(-(-samples // width)))[:, None] * exponents)
    return np.concatenate([steps.real, steps.imag]), begins


def _exponential_products(
    values: FloatArray, steps: FloatArray, begins: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return Σ values e^{pk} over the samples for each exponent, shape (K,)."""
    blocks, count = begins.shape
    width = steps.shape[1]
    padded = np.zeros(blocks * width)
    padded[: values.size] = values
    inner = padded.reshape(blocks, width) @ steps.T
    return np.sum((inner[:, :count] + 1j * inner[:, count:]) * begins, axis=0)


def _gram(
    exponents: NDArray[np.complex128], first: int, trend: FloatArray, with_trend: FloatArray
) -> FloatArray:
    """Return the products of the terms Re …, Im …, one, trend, given those with the trend."""
    plus = _geometric(exponents[:, None] + exponents, first, trend.size)
    minus = _geometric(exponents[:, None] + np.conj(exponents), first, trend.size)
    sums = _geometric(exponents, first, trend.size)
    gram = np.empty((with_trend.size, with_trend.size))
    gram[:-2, :-2] = in_parts(plus, minus)
    gram[-2, :-2] = gram[:-2, -2] = np.concatenate([sums.real, sums.imag])
    gram[-2, -2] = trend.size
    gram[-1] = with_trend
    gram[:, -1] = with_trend
    return gram


def in_parts(plus: NDArray[np.complex128], minus: NDArray[np.complex128]) -> FloatArray:
    """Return the products of real and imaginary parts, given those of the complex exponentials.

    Args:
        plus: products of e^{pk} with e^{qk}, shape (K, K).
        minus: products of e^{pk} with the conjugate of e^{qk}, shape (K, K).

    Returns:
        Of the real parts, then the imaginary ones, shape (2 K, 2 K).
    """
    mixed = 0.5 * (plus - minus).imag
    return np.block([[0.5 * (plus + minus).real, mixed], [mixed.T, 0.5 * (minus - plus).real]])


def _geometric(
    exponents: NDArray[np.complex128], first: int, samples: int
) -> NDArray[np.complex128]:
    """Return Σ e^{pk} over ``samples`` samples from ``first`` on."""
    constant = np.abs(exponents) * samples < 1e-12
    step = np.where(constant, 1.0, np.expm1(exponents))
    return np.exp(exponents * first) * np.where(
        constant, float(samples), np.expm1(exponents * samples) / step
    )


def fitted(terms: Terms, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least-squares amounts of the terms, shape (R,), and the residual, shape (n,)."""
    inverse = inverse_where_shown(terms.gram, MIN_SCALED_EIGENVALUE)
    amounts = inverse @ terms.products(values)
    # One step of refinement, as normal equations lose half the digits.
    amounts = amounts + inverse @ terms.products(values - terms.sum(amounts))
    return amounts, values - terms.sum(amounts)

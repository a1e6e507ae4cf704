"""Terms that a sine record is fitted by: exponentials, offset and trend, without writing every term out.

A sum over N samples with an exponential e^{pk} needs no table of N values: k = W i + j makes it a product of two tables
of about √N values, and all exponentials together one product of matrices. Sums of exponentials alone are geometric.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.fit.information import inverse_where_shown

#: Terms are told apart where their scaled normal matrix has eigenvalues above this.
TOLD_APART = 1e-10


class Terms(Protocol):
    """R real terms over the n samples of a span."""

    @property
    def gram(self) -> FloatArray:
        """Their products with each other, shape (R, R)."""
        ...

    def products(self, values: FloatArray) -> FloatArray:
        """Their products with a series, shape (n,) → (R,)."""
        ...

    def sum(self, amounts: FloatArray) -> FloatArray:
        """The terms in these amounts, shape (R,) → (n,)."""
        ...

    def only(self, which: NDArray[np.int_]) -> Terms:
        """Some of the terms."""
        ...


@dataclass(frozen=True, eq=False)
class WrittenOut:
    """Terms sample by sample, zero where samples are not used.

    Attributes:
        rows: shape (R, n).
        gram: of these.
    """

    rows: FloatArray
    gram: FloatArray

    @classmethod
    def of(cls, rows: FloatArray) -> WrittenOut:
        """These rows."""
        return cls(rows, rows @ rows.T)

    def products(self, values: FloatArray) -> FloatArray:
        """As :meth:`Terms.products`."""
        return self.rows @ values

    def sum(self, amounts: FloatArray) -> FloatArray:
        """As :meth:`Terms.sum`."""
        return amounts @ self.rows

    def only(self, which: NDArray[np.int_]) -> WrittenOut:
        """As :meth:`Terms.only`."""
        return WrittenOut(self.rows[which], self.gram[np.ix_(which, which)])


@dataclass(frozen=True, eq=False)
class Exponentials:
    """Real and imaginary parts of e^{pk} for K exponents p, one, and a trend, over samples without a gap.

    Attributes:
        steps: Re, then Im, of e^{pj}, j = 0 … W − 1, shape (2 K, W).
        begins: e^{p(first + W i)}, shape (blocks, K).
        trend: shape (n,).
        order: which of the terms Re …, Im …, one, trend are used, shape (R,).
        gram: of these.
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
        """Over the samples from ``first`` on for which there is a trend."""
        steps, begins = _tables(exponents, first, trend.size)
        made = cls(steps, begins, trend, order, np.zeros((0, 0)))
        gram = _gram(exponents, first, trend, made._with_trend(trend))
        return cls(steps, begins, trend, order, gram[np.ix_(order, order)])

    def _with_trend(self, values: FloatArray) -> FloatArray:
        """Products of all terms with a series, shape (n,) → (2 K + 2,)."""
        sums = _summed(values, self.steps, self.begins)
        return np.concatenate([sums.real, sums.imag, [np.sum(values), self.trend @ values]])

    def products(self, values: FloatArray) -> FloatArray:
        """As :meth:`Terms.products`."""
        return self._with_trend(values)[self.order]

    def sum(self, amounts: FloatArray) -> FloatArray:
        """As :meth:`Terms.sum`."""
        count = self.begins.shape[1]
        every = np.zeros(2 * count + 2)
        every[self.order] = amounts
        found = _swung(every[:count] - 1j * every[count:-2], self.steps, self.begins)[
            : self.trend.size
        ]
        found += every[-2]
        found += every[-1] * self.trend
        return found

    def only(self, which: NDArray[np.int_]) -> Exponentials:
        """As :meth:`Terms.only`."""
        gram = self.gram[np.ix_(which, which)]
        return Exponentials(self.steps, self.begins, self.trend, self.order[which], gram)


def products(
    values: FloatArray, exponents: NDArray[np.complex128], first: int = 0
) -> NDArray[np.complex128]:
    """Σ values e^{pk} over the samples k from ``first`` on, for each of K exponents, shape (K,)."""
    return _summed(values, *_tables(exponents, first, values.size))


def _swung(
    amounts: NDArray[np.complex128], steps: FloatArray, begins: NDArray[np.complex128]
) -> FloatArray:
    own = begins * amounts
    return (np.concatenate([own.real, -own.imag], axis=1) @ steps).ravel()


def _tables(
    exponents: NDArray[np.complex128], first: int, samples: int
) -> tuple[FloatArray, NDArray[np.complex128]]:
    """Steps and begins of so many samples, as :class:`Exponentials` has them."""
    width = max(int(np.sqrt(samples)), 1)
    steps: NDArray[np.complex128] = np.asarray(
        np.exp(exponents[:, None] * np.arange(width)), dtype=complex
    )
    begins = np.exp((first + width * np.arange(-(-samples // width)))[:, None] * exponents)
    return np.concatenate([steps.real, steps.imag]), begins


def _summed(
    values: FloatArray, steps: FloatArray, begins: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    (blocks, count), width = begins.shape, steps.shape[1]
    laid = np.zeros(blocks * width)
    laid[: values.size] = values
    inner = laid.reshape(blocks, width) @ steps.T
    return np.sum((inner[:, :count] + 1j * inner[:, count:]) * begins, axis=0)


def _gram(
    exponents: NDArray[np.complex128], first: int, trend: FloatArray, with_trend: FloatArray
) -> FloatArray:
    """Products of the terms Re …, Im …, one, trend with each other, given those with the trend."""
    plus = _geometric(exponents[:, None] + exponents, first, trend.size)
    minus = _geometric(exponents[:, None] + np.conj(exponents), first, trend.size)
    alone = _geometric(exponents, first, trend.size)
    gram = np.empty((with_trend.size, with_trend.size))
    gram[:-2, :-2] = in_parts(plus, minus)
    gram[-2, :-2] = gram[:-2, -2] = np.concatenate([alone.real, alone.imag])
    gram[-2, -2] = trend.size
    gram[-1], gram[:, -1] = with_trend, with_trend
    return gram


def in_parts(plus: NDArray[np.complex128], minus: NDArray[np.complex128]) -> FloatArray:
    """Products of real and imaginary parts with each other, of those of e^{pk} with e^{qk}, and with its conjugate."""
    mixed = 0.5 * (plus - minus).imag
    return np.block([[0.5 * (plus + minus).real, mixed], [mixed.T, 0.5 * (minus - plus).real]])


def _geometric(
    exponents: NDArray[np.complex128], first: int, samples: int
) -> NDArray[np.complex128]:
    """Σ e^{pk} over ``samples`` samples from ``first`` on."""
    one = np.abs(exponents) * samples < 1e-12
    step = np.where(one, 1.0, np.expm1(exponents))
    return np.exp(exponents * first) * np.where(
        one, float(samples), np.expm1(exponents * samples) / step
    )


def fitted(terms: Terms, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Amounts of the terms, shape (R,), and what they leave of a series, shape (n,), by least squares."""
    inverse = inverse_where_shown(terms.gram, TOLD_APART)
    found = inverse @ terms.products(values)
    # One step of refinement: normal equations lose half the digits.
    found = found + inverse @ terms.products(values - terms.sum(found))
    return found, values - terms.sum(found)

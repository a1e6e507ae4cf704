"""A ratio of polynomials in s, to compute with as with a number: how a formula becomes coefficients.

A formula of s in Python operators, evaluated with :data:`S` in place of a number, gives its
numerator and denominator. Coefficients are numbers, arrays or tracers. Zeros and ones that are
integers stand in the formula itself and are never computed with, so that the order of a
polynomial does not depend on values. A formula that is not rational raises TypeError or
AttributeError.
"""

from __future__ import annotations

from itertools import zip_longest
from typing import Any

Coefficients = tuple[Any, ...]  # ascending powers of s

_ONE: Coefficients = (1,)


class Ratio:
    """A ratio of polynomials with ascending coefficients; it does not change.

    What is the same object in numerator and denominator cancels: a voltage divider with one
    impedance twice has no pole too many.
    """

    __slots__ = ("denominator", "numerator")
    __array_ufunc__ = None  # NumPy leaves the operators to this class, and refuses functions of it

    def __init__(self, numerator: Coefficients, denominator: Coefficients = _ONE) -> None:
        self.numerator = numerator
        self.denominator = denominator

    def __add__(self, other: Any) -> Ratio:
        """Add a ratio or a number."""
        term = _ratio(other)
        if term is None:
            return NotImplemented
        if term.denominator is self.denominator:
            return Ratio(_sum(self.numerator, term.numerator), self.denominator)
        crossed = (
            _product(self.numerator, term.denominator),
            _product(term.numerator, self.denominator),
        )
        return Ratio(_sum(*crossed), _product(self.denominator, term.denominator))

    def __mul__(self, other: Any) -> Ratio:
        """Multiply with a ratio or a number."""
        factor = _ratio(other)
        if factor is None:
            return NotImplemented
        if factor.numerator is self.denominator:
            return Ratio(self.numerator, factor.denominator)
        if factor.denominator is self.numerator:
            return Ratio(factor.numerator, self.denominator)
        return Ratio(
            _product(self.numerator, factor.numerator),
            _product(self.denominator, factor.denominator),
        )

    def __truediv__(self, other: Any) -> Ratio:
        """Divide by a ratio or a number."""
        divisor = _ratio(other)
        if divisor is None:
            return NotImplemented
        if divisor.denominator is self.denominator:
            return Ratio(self.numerator, divisor.numerator)
        return self * Ratio(divisor.denominator, divisor.numerator)

    def __pow__(self, power: Any) -> Ratio:
        """Raise to a whole power."""
        if not isinstance(power, int):
            return NotImplemented
        if power == 0:
            return Ratio(_ONE)
        result = self
        for _ in range(abs(power) - 1):
            result = result * self
        return result if power >= 0 else Ratio(result.denominator, result.numerator)

    def __neg__(self) -> Ratio:
        """Change the sign."""
        return Ratio(tuple(-coefficient for coefficient in self.numerator), self.denominator)

    def __pos__(self) -> Ratio:
        """Leave the sign."""
        return self

    def __sub__(self, other: Any) -> Ratio:
        """Subtract a ratio or a number."""
        term = _ratio(other)
        return NotImplemented if term is None else self + (-term)

    def __rsub__(self, other: Any) -> Ratio:
        """Subtract from a number."""
        return (-self) + other

    def __rtruediv__(self, other: Any) -> Ratio:
        """Divide a number."""
        dividend = _ratio(other)
        return NotImplemented if dividend is None else dividend / self

    __radd__ = __add__
    __rmul__ = __mul__

    def reduced(self) -> tuple[Coefficients, Coefficients]:
        """Return numerator and denominator without common powers of s, the denominator monic."""
        common = min(_zeros_at_rest(self.numerator), _zeros_at_rest(self.denominator))
        numerator = self.numerator[common:]
        denominator = self.denominator[common:]
        lead = denominator[-1]
        if not _stands(lead, 1):
            numerator = tuple(_over(coefficient, lead) for coefficient in numerator)
            denominator = (*(_over(coefficient, lead) for coefficient in denominator[:-1]), 1)
        return numerator, denominator


#: The variable s.
S = Ratio((0, 1))


def _ratio(value: Any) -> Ratio | None:
    """Return a number or an array as a ratio; None of anything else."""
    if type(value) is Ratio:
        return value
    is_number = isinstance(value, (int, float, complex)) or hasattr(value, "dtype")
    return Ratio((value,)) if is_number else None


def _stands(coefficient: Any, number: int) -> bool:
    """Return whether this whole number stands in the formula itself."""
    return type(coefficient) is int and coefficient == number


def _zeros_at_rest(coefficients: Coefficients) -> int:
    for power, coefficient in enumerate(coefficients):
        if not _stands(coefficient, 0):
            return power
    return len(coefficients) - 1


def _times(factor: Any, other: Any) -> Any:
    if type(factor) is int and factor in (0, 1):
        return other if factor else 0
    if type(other) is int and other in (0, 1):
        return factor if other else 0
    return factor * other


def _over(dividend: Any, divisor: Any) -> Any:
    return dividend if _stands(dividend, 0) else dividend / divisor


def _plus(term: Any, other: Any) -> Any:
    if type(term) is int and not term:
        return other
    return term if type(other) is int and not other else term + other


def _sum(polynomial: Coefficients, other: Coefficients) -> Coefficients:
    terms = [_plus(*pair) for pair in zip_longest(polynomial, other, fillvalue=0)]
    while len(terms) > 1 and _stands(terms[-1], 0):
        terms.pop()
    return tuple(terms)


def _product(polynomial: Coefficients, other: Coefficients) -> Coefficients:
    if other is _ONE:
        return polynomial
    if polynomial is _ONE:
        return other
    if len(polynomial) == 1:
        return tuple([_times(polynomial[0], coefficient) for coefficient in other])
    if len(other) == 1:
        return tuple([_times(coefficient, other[0]) for coefficient in polynomial])
    terms: list[Any] = [0] * (len(polynomial) + len(other) - 1)
    for i, factor in enumerate(polynomial):
        for j, coefficient in enumerate(other):
            terms[i + j] = _plus(terms[i + j], _times(factor, coefficient))
    return tuple(terms)

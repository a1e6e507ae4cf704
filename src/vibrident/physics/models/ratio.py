"""Ratio of polynomials in s that takes part in arithmetic like a number.

Evaluate a formula of s in Python operators with :data:`S` in place of a number to get its numerator
and denominator. Coefficients are numbers, arrays or tracers. Integer zeros and ones are literals of
the formula and are never computed with, so that the order of a polynomial does not depend on
values. A formula that is not rational raises TypeError or AttributeError.
"""

from __future__ import annotations

from itertools import zip_longest
from typing import Any

Coefficients = tuple[Any, ...]  # ascending powers of s

_UNIT_POLYNOMIAL: Coefficients = (1,)


class Ratio:
    """Immutable ratio of polynomials with ascending coefficients.

    A factor that is the same object in numerator and denominator cancels, so that a voltage divider
    with one impedance twice has no superfluous pole.
    """

    __slots__ = ("denominator", "numerator")
    __array_ufunc__ = None  # NumPy leaves the operators to this class, and refuses functions of it

    def __init__(
        self, numerator: Coefficients, denominator: Coefficients = _UNIT_POLYNOMIAL
    ) -> None:
        self.numerator: Coefficients = numerator
        self.denominator: Coefficients = denominator

    def __add__(self, operand: Any) -> Ratio:
        """Add a ratio or a number."""
        term = _ratio(operand)
        if term is None:
            return NotImplemented
        if term.denominator is self.denominator:
            return Ratio(_sum(self.numerator, term.numerator), self.denominator)
        crossed = (
            product(self.numerator, term.denominator),
            product(term.numerator, self.denominator),
        )
        return Ratio(_sum(*crossed), product(self.denominator, term.denominator))

    def __mul__(self, operand: Any) -> Ratio:
        """Multiply with a ratio or a number."""
        factor = _ratio(operand)
        if factor is None:
            return NotImplemented
        if factor.numerator is self.denominator:
            return Ratio(self.numerator, factor.denominator)
        if factor.denominator is self.numerator:
            return Ratio(factor.numerator, self.denominator)
        return Ratio(
            product(self.numerator, factor.numerator),
            product(self.denominator, factor.denominator),
        )

    def __truediv__(self, operand: Any) -> Ratio:
        """Divide by a ratio or a number."""
        divisor = _ratio(operand)
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
            return Ratio(_UNIT_POLYNOMIAL)
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

    def __sub__(self, operand: Any) -> Ratio:
        """Subtract a ratio or a number."""
        term = _ratio(operand)
        return NotImplemented if term is None else self + (-term)

    def __rsub__(self, operand: Any) -> Ratio:
        """Subtract from a number."""
        return (-self) + operand

    def __rtruediv__(self, operand: Any) -> Ratio:
        """Divide a number."""
        dividend = _ratio(operand)
        return NotImplemented if dividend is None else dividend / self

    __radd__ = __add__
    __rmul__ = __mul__

    def reduced(self) -> tuple[Coefficients, Coefficients]:
        """Return numerator and denominator without common powers of s, the denominator monic."""
        common = min(_zeros_at_rest(self.numerator), _zeros_at_rest(self.denominator))
        numerator = self.numerator[common:]
        denominator = self.denominator[common:]
        lead = denominator[-1]
        if not _is_literal(lead, 1):
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


def _is_literal(coefficient: Any, number: int) -> bool:
    """Return whether a coefficient is this whole number, written in the formula itself."""
    return type(coefficient) is int and coefficient == number


def _zeros_at_rest(coefficients: Coefficients) -> int:
    """Return the number of zeros of a polynomial at s = 0."""
    for power, coefficient in enumerate(coefficients):
        if not _is_literal(coefficient, 0):
            return power
    return len(coefficients) - 1


def _times(first: Any, second: Any) -> Any:
    """Return a product, without computing with a zero or one of the formula itself."""
    if type(first) is int and first in (0, 1):
        return second if first else 0
    if type(second) is int and second in (0, 1):
        return first if second else 0
    return first * second


def _over(dividend: Any, divisor: Any) -> Any:
    """Return a quotient, without computing with a zero of the formula itself."""
    return dividend if _is_literal(dividend, 0) else dividend / divisor


def _plus(first: Any, second: Any) -> Any:
    """Return a sum, without computing with a zero of the formula itself."""
    if type(first) is int and not first:
        return second
    return first if type(second) is int and not second else first + second


def _sum(first: Coefficients, second: Coefficients) -> Coefficients:
    """Return the sum of two polynomials."""
    terms = [_plus(*pair) for pair in zip_longest(first, second, fillvalue=0)]
    while len(terms) > 1 and _is_literal(terms[-1], 0):
        terms.pop()
    return tuple(terms)


def product(first: Coefficients, second: Coefficients) -> Coefficients:
    """Return the product of two polynomials with ascending coefficients."""
    if second is _UNIT_POLYNOMIAL:
        return first
    if first is _UNIT_POLYNOMIAL:
        return second
    if len(first) == 1:
        return tuple([_times(first[0], coefficient) for coefficient in second])
    if len(second) == 1:
        return tuple([_times(coefficient, second[0]) for coefficient in first])
    terms: list[Any] = [0] * (len(first) + len(second) - 1)
    for i, factor in enumerate(first):
        for j, coefficient in enumerate(second):
            terms[i + j] = _plus(terms[i + j], _times(factor, coefficient))
    return tuple(terms)

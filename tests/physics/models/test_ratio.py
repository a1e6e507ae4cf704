"""A formula of s computed with coefficients is the formula computed with numbers."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.physics.models.ratio import Ratio, S

AT = 1j * np.geomspace(0.1, 1000.0, 7)

FORMULAS = {
    "low-pass": (lambda s: 3.0 / (1 + s * 0.2), 1),
    "series circuit": (lambda s: 50 / (50 + s * 1e-3 + 1 / (s * 1e-2)), 2),
    "divider of one impedance twice": (lambda s: divider(s, 2.0 + s * 0.3, 5.0 / (1 + s * 0.1)), 2),
    "powers": (lambda s: (1 - s**2) / (2 + s**-1) - 4, 1),
    "difference": (lambda s: 1 / (1 + s) - 1 / (2 + s), 2),
    "arrays": (lambda s: np.float64(2.0) * s / (np.float64(3.0) + s), 1),
}


def divider(s, one, other):
    return other / (one + other)


def value(coefficients, s):
    return sum(coefficient * s**power for power, coefficient in enumerate(coefficients))


@pytest.mark.parametrize("name", FORMULAS)
def test_coefficients_give_the_formulas_values_and_no_pole_too_many(name):
    formula, order = FORMULAS[name]
    numerator, denominator = formula(S).reduced()
    assert value(numerator, AT) / value(denominator, AT) == pytest.approx(formula(AT), rel=1e-12)
    assert denominator[-1] == 1
    assert len(denominator) - 1 == order


def test_the_order_does_not_depend_on_values():
    formula = lambda s, a: 1.0 / (1.0 + a * s + s**2)  # noqa: E731
    assert len(formula(S, 0.0).reduced()[1]) == len(formula(S, 1.0).reduced()[1]) == 3


@pytest.mark.parametrize("function", [np.exp, np.sqrt, abs, lambda s: s**0.5, lambda s: s.imag, lambda s: s + "a"])
def test_what_is_not_rational_is_refused(function):
    with pytest.raises((TypeError, AttributeError)):
        function(S)


def test_many_systems_at_once_have_arrays_of_coefficients():
    lag = np.array([1.0, 2.0, 3.0])
    ratio = 1.0 / (1.0 + lag * S)
    assert isinstance(ratio, Ratio)
    numerator, denominator = ratio.reduced()
    assert numerator[0] == pytest.approx(1.0 / lag)
    assert denominator[0] == pytest.approx(1.0 / lag)

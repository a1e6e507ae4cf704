"""Values of several laboratories: weighted mean, consistency and degrees of equivalence.

The evaluation is procedure A of
M. G. Cox, The evaluation of key comparison data, Metrologia 39 (2002) 589-595.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.tails import chi2_tail
from vibrident.use.comparison import COVERAGE_FACTOR


@dataclass(frozen=True)
class Equivalence:
    """Deviation of a laboratory's value from the weighted mean of all.

    Attributes:
        difference: the value less the mean, in the unit of the values.
        expanded: U of the difference, k = 2: U² = 4 (u² − u_mean²), as the value is part of the
            mean.
        e_n: difference over ``expanded``; None where the value is all of the mean.
    """

    difference: float
    expanded: float
    e_n: float | None


@dataclass(frozen=True)
class Agreement:
    """Consistency of several values of one quantity.

    Attributes:
        mean: weighted by 1/u², in the unit of the values.
        u: standard uncertainty of the mean.
        chi2: observed χ² of the differences.
        degrees_of_freedom: of χ², the number of values less one.
        probability: of a larger χ² for consistent values, which are taken for consistent from 0.05
            on.
        laboratories: one a value, in the order given.
    """

    mean: float
    u: float
    chi2: float
    degrees_of_freedom: int
    probability: float
    laboratories: tuple[Equivalence, ...]


def agreement(values: Sequence[float], uncertainties: Sequence[float]) -> Agreement:
    """Return the weighted mean of independent values, and the deviation of each from it.

    Args:
        values: one a laboratory, in one unit, at least two.
        uncertainties: their standard uncertainties, positive, in that unit.

    Raises:
        InputError: there are fewer than two, or an uncertainty is not a positive number.

    Examples:
        >>> import vibrident
        >>> comparison = vibrident.agreement([0.1002, 0.1004, 0.1003], [2e-4, 2e-4, 1e-4])
        >>> round(comparison.mean, 5)
        0.1003
        >>> comparison.probability > 0.05  # the values are consistent
        True
    """
    x = np.asarray(values, float)
    u = np.asarray(uncertainties, float)
    if (
        x.size < 2
        or x.shape != u.shape
        or not np.all(np.isfinite(x))
        or not np.all(np.isfinite(u) & (u > 0))
    ):
        raise InputError(
            "These values cannot be compared.",
            expected="two values or more, each with a standard uncertainty above zero",
            found=f"{x.size} values, {u.size} uncertainties",
            where="values of laboratories",
            remedy="give one of each for every laboratory",
        )
    weight = 1.0 / u**2
    mean = float(np.sum(weight * x) / np.sum(weight))
    u_mean = float(1.0 / math.sqrt(np.sum(weight)))
    chi2 = float(np.sum(((x - mean) / u) ** 2))
    laboratories = []
    for value, value_u in zip(x.tolist(), u.tolist(), strict=True):
        expanded = COVERAGE_FACTOR * math.sqrt(max(value_u**2 - u_mean**2, 0.0))
        laboratories.append(
            Equivalence(value - mean, expanded, (value - mean) / expanded if expanded else None)
        )
    return Agreement(
        mean, u_mean, chi2, x.size - 1, chi2_tail(x.size - 1, chi2), tuple(laboratories)
    )

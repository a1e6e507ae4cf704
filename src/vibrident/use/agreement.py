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
    """Deviation of a laboratory's value from the weighted mean of all."""

    difference: float  # the value less the mean
    # U of the difference, k = 2: U² = 4 (u² − u_mean²), as the value is part of the mean
    expanded: float
    e_n: float | None  # difference over ``expanded``; None where the value is all of the mean


@dataclass(frozen=True)
class Agreement:
    """Consistency of several values of one quantity."""

    mean: float  # weighted by 1/u²
    u: float  # its standard uncertainty
    chi2: float  # observed χ² of the differences; of ``degrees_of_freedom``
    degrees_of_freedom: int
    # of a larger χ² for consistent values; they are taken for consistent from 0.05 on
    probability: float
    laboratories: tuple[Equivalence, ...]  # in the order given


def agreement(values: Sequence[float], uncertainties: Sequence[float]) -> Agreement:
    """Return the weighted mean of independent values, and the deviation of each from it.

    Args:
        values: one a laboratory, in one unit, at least two.
        uncertainties: their standard uncertainties, positive, in that unit.

    Raises:
        InputError: there are fewer than two, or an uncertainty is not a positive number.
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

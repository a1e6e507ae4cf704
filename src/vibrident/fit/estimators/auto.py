"""Which estimator suits the data, and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vibrident.base.errors import ModelError
from vibrident.fit.estimators.base import Estimator
from vibrident.fit.registry import AUTO, ESTIMATORS

if TYPE_CHECKING:
    from vibrident.fit.problem import Evidence


def ranked() -> tuple[Estimator, ...]:
    """Every estimator with its settings at their defaults, in the order in which methods are compared."""
    return tuple(sorted(ESTIMATORS.all().values(), key=lambda one: (one.rank, one.name)))


def choose(evidence: Evidence) -> tuple[Estimator, str]:
    """The estimator for these data, and the reason in words.

    Raises:
        ModelError: no estimator suits.
    """
    for one in ranked():
        if reason := one.suits(evidence):
            return one, f"{AUTO}: {reason}"
    raise ModelError(
        "No estimator suits these data.",
        expected="a table, or records with a reference",
        found=f"a model {evidence.model.name!r} with other data",
        where="estimator",
        remedy="name the estimator",
    )

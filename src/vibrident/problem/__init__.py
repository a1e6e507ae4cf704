"""Data and model → one weighted residual that every estimator shares."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vibrident.problem.coordinates import Coordinates
from vibrident.problem.evidence import Evidence
from vibrident.problem.frequency_domain import FrequencyProblem

if TYPE_CHECKING:
    from vibrident.problem.time_domain import TimeProblem

__all__ = ["Coordinates", "Evidence", "FrequencyProblem", "TimeProblem"]


def __getattr__(name: str) -> Any:
    """The network unrolled in time, which loads JAX, where it is asked for."""
    if name == "TimeProblem":
        from vibrident.problem.time_domain import TimeProblem

        return TimeProblem
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

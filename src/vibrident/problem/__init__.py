"""Data and model → one weighted residual that every estimator shares."""

from __future__ import annotations

from vibrident.problem.coordinates import Coordinates

from vibrident.problem.time_domain import TimeProblem

__all__ = ["Coordinates", "TimeProblem"]

"""Data and model → one weighted residual that every estimator shares."""

from __future__ import annotations

from vibrident.problem.coordinates import Coordinates
from vibrident.problem.evidence import Evidence
from vibrident.problem.frequency_domain import FrequencyProblem
from vibrident.problem.time_domain import TimeProblem

__all__ = ["Coordinates", "Evidence", "FrequencyProblem", "TimeProblem"]

"""Data and model → one weighted residual that every estimator shares."""

from __future__ import annotations

from vibrident.problem.coordinates import Coordinates
from vibrident.problem.evidence import Evidence
from vibrident.problem.frequency_domain import FrequencyProblem, Local
from vibrident.problem.line_problem import LineProblem
from vibrident.problem.network_problem import NetworkProblem, network_objective, network_of

__all__ = [
    "Coordinates",
    "Evidence",
    "FrequencyProblem",
    "LineProblem",
    "Local",
    "NetworkProblem",
    "network_objective",
    "network_of",
]

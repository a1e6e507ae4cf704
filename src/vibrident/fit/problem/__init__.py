"""Data and model → one weighted residual that every estimator shares."""

from __future__ import annotations

from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.problem.evidence import Evidence
from vibrident.fit.problem.frequency_domain import FrequencyProblem, Local
from vibrident.fit.problem.network import network_of
from vibrident.fit.problem.network_problem import NetworkProblem, network_objective

__all__ = [
    "BinProblem",
    "Coordinates",
    "Evidence",
    "FrequencyProblem",
    "Local",
    "NetworkProblem",
    "network_objective",
    "network_of",
]

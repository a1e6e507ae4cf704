"""Estimators, one a file; each holds settings only.

``fit`` changes nothing and returns an :class:`Estimate`.
"""

from __future__ import annotations

from vibrident.fit.estimators.base import Estimate, Estimator, choose, ranked
from vibrident.fit.estimators.kinds.ipnn import Ipnn
from vibrident.fit.estimators.kinds.ml import MaximumLikelihood
from vibrident.fit.registry import AUTO

__all__ = ["AUTO", "Estimate", "Estimator", "Ipnn", "MaximumLikelihood", "choose", "ranked"]

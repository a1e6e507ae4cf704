"""Estimators: one a file, settings only; ``fit`` changes nothing and returns an :class:`Estimate`."""

from __future__ import annotations

from vibrident.estimators.auto import AUTO, choose, ranked
from vibrident.estimators.base import Estimate, Estimator
from vibrident.estimators.kinds.ipnn import Ipnn
from vibrident.estimators.kinds.lsm import LeastSquares
from vibrident.estimators.kinds.ml import MaximumLikelihood

__all__ = ["AUTO", "Estimate", "Estimator", "Ipnn", "LeastSquares", "MaximumLikelihood", "choose", "ranked"]

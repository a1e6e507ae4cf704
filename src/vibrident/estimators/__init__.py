"""Estimators: one a file, settings only; ``fit`` changes nothing and returns an :class:`Estimate`."""

from __future__ import annotations

from vibrident.estimators.auto import choose
from vibrident.estimators.base import Estimate, Estimator
from vibrident.estimators.ipnn import Ipnn
from vibrident.estimators.lsm import LeastSquares
from vibrident.estimators.ml import MaximumLikelihood

__all__ = ["Estimate", "Estimator", "Ipnn", "LeastSquares", "MaximumLikelihood", "choose"]

"""The registries of estimators and of departures from a fit."""

from __future__ import annotations

from typing import Any

from vibrident.base.errors import ModelError
from vibrident.base.registry import Registry
from vibrident.data.registry import READERS
from vibrident.physics.registry import MODELS

AUTO = "auto"  # in place of an estimator's name: the one that suits the data
#: ``vibrident.fit.estimators.base.Estimator`` objects, each with its settings at their defaults.
ESTIMATORS: Registry[Any] = Registry(
    "estimator",
    "vibrident.estimators",
    ("fit/estimators/kinds", "paper/estimators"),
    ("vibrident.fit.estimators.base:Estimator",),
    "estimator",
    ModelError,
)
#: ``vibrident.fit.departures.departure.Departure`` objects.
DEPARTURES: Registry[Any] = Registry(
    "departure",
    "vibrident.departures",
    ("fit/departures/kinds",),
    ("vibrident.fit.departures.departure:Departure",),
    "departure",
    ModelError,
)
#: All that another package can add and that takes part in an identification.
TAKING_PART: tuple[Registry[Any], ...] = (MODELS, ESTIMATORS, READERS, DEPARTURES)

"""Registry of the sensor models and add-ons."""

from __future__ import annotations

from typing import Any

from vibrident.base.errors import ModelError
from vibrident.base.registry import Registry

ADD_ONS = "physics/models/add_ons"
#: ``vibrident.physics.models.Model`` and ``AddOn`` objects.
MODELS: Registry[Any] = Registry(
    "sensor model",
    "vibrident.models",
    ("physics/models/cores", ADD_ONS),
    ("vibrident.physics.models.model:Model", "vibrident.physics.models.base:AddOn"),
    "model",
    ModelError,
)

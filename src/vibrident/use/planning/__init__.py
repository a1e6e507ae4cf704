"""Planning: expected uncertainty, best choice of frequencies, and another mounting."""

from __future__ import annotations

from vibrident.use.planning.calibration import Plan, plan, plan_document
from vibrident.use.planning.mounting import MountedSensor, mounted_document, predict_mounted
from vibrident.use.planning.points import Recording

__all__ = [
    "MountedSensor",
    "Plan",
    "Recording",
    "mounted_document",
    "plan",
    "plan_document",
    "predict_mounted",
]

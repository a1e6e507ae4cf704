"""Planning a calibration: the expected uncertainty, and the best choice of frequencies."""

from __future__ import annotations

from vibrident.use.planning.calibration import Plan, plan, plan_document
from vibrident.use.planning.points import Recording

__all__ = ["Plan", "Recording", "plan", "plan_document"]

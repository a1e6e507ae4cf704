"""The fits of many calibrations at once on a device: one program for all of equal shape."""

from __future__ import annotations

from vibrident.batched.together import Together, identified_together

__all__ = ["Together", "identified_together"]

"""One joint fit of several calibrations of one sensor."""

from __future__ import annotations

from vibrident.joint.identification import identify_together

__all__ = ["identify_together"]

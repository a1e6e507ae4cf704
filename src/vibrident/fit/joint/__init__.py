"""Joint fit of several calibrations of one sensor."""

from vibrident.fit.joint.identification import identify_together

__all__ = ["identify_together"]

"""Acceleration from a measured response: the sensor's dynamics compensated in a stated band."""

from vibrident.use.correction.acceleration import Correction, Corrections, correct
from vibrident.use.correction.band import Band
from vibrident.use.correction.peak import Peak
from vibrident.use.correction.report import correction_document

__all__ = ["Band", "Correction", "Corrections", "Peak", "correct", "correction_document"]

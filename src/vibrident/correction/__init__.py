"""Acceleration from a measured response: the sensor's dynamics compensated in a stated band, with uncertainty."""

from vibrident.correction.acceleration import Correction, Corrections, correct
from vibrident.correction.band import Band
from vibrident.correction.peak import Peak
from vibrident.correction.report import correction_document

__all__ = ["Band", "Correction", "Corrections", "Peak", "correct", "correction_document"]

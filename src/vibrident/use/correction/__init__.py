"""Acceleration from a measured response: the sensor's dynamics compensated in a stated band."""

from vibrident.use.correction.acceleration import Correction, Corrections, correct
from vibrident.use.correction.band import PassBand
from vibrident.use.correction.peak import Peak
from vibrident.use.correction.report import correction_document

__all__ = ["Correction", "Corrections", "PassBand", "Peak", "correct", "correction_document"]

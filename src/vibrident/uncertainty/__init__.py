"""From an estimate's covariance to what a laboratory signs: parameters, curve, adequacy, what is not determined."""

from vibrident.uncertainty.adequacy import Adequacy, assess
from vibrident.uncertainty.curve import curve
from vibrident.uncertainty.parameters import correlation, doubts, parameter_table, with_reference

__all__ = ["Adequacy", "assess", "correlation", "curve", "doubts", "parameter_table", "with_reference"]

"""Uncertainty: from an estimate's covariance to what a laboratory signs.

Parameters, curve, adequacy, and what the data do not determine.
"""

from vibrident.fit.uncertainty.adequacy import Adequacy, assess
from vibrident.fit.uncertainty.curve import curve
from vibrident.fit.uncertainty.parameters import (
    correlation,
    parameter_table,
    weakly_determined,
    with_reference,
)

__all__ = [
    "Adequacy",
    "assess",
    "correlation",
    "curve",
    "parameter_table",
    "weakly_determined",
    "with_reference",
]

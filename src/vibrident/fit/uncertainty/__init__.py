"""Uncertainty, from the covariance of an estimate to the values that a laboratory signs.

It covers parameters, curve, adequacy, budget, and parameters that the data do not determine.
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

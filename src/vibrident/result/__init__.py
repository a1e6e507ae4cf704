"""The one result of an identification, and what it is made of.

Reports, plots, exports and the page render from it alone, without the data and without JAX.
"""

from vibrident.base.warning_kinds import WARNING_CODES, WarningCode
from vibrident.result.document import MOST_BYTES, SCHEMA
from vibrident.result.parts import (
    Correlation,
    Curve,
    Finding,
    Fit,
    MeasuredCurve,
    Parameter,
    ResultWarning,
    Signal,
    Training,
)
from vibrident.result.result import TRACKED, Result

__all__ = [
    "MOST_BYTES",
    "SCHEMA",
    "TRACKED",
    "WARNING_CODES",
    "Correlation",
    "Curve",
    "Finding",
    "Fit",
    "MeasuredCurve",
    "Parameter",
    "Result",
    "ResultWarning",
    "Signal",
    "Training",
    "WarningCode",
]

"""Result of an identification, and its parts.

Reports, plots, exports and the page render from it alone, without the data and without JAX.
"""

from vibrident.base.warning_kinds import WARNING_CODES, WarningCode
from vibrident.result.document import MAX_FILE_BYTES, SCHEMA
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
    "MAX_FILE_BYTES",
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

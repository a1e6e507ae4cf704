"""What was measured, in physical units: records, tabulated responses, the calibration that holds them. Validated."""

from vibrident.data.effects import Capability, Circumstances, SystematicEffect
from vibrident.data.records.basis import (
    EXCITATIONS,
    LARGEST,
    QUANTITIES,
    REFERENCE_UNITS,
    STANDARD_GRAVITY,
    USUAL_MODEL,
    BoolArray,
    Excitation,
    FloatArray,
    Provenance,
    Quantity,
)
from vibrident.data.records.calibration import Calibration
from vibrident.data.records.record import Record, ResponseTable

__all__ = [
    "EXCITATIONS",
    "LARGEST",
    "QUANTITIES",
    "REFERENCE_UNITS",
    "STANDARD_GRAVITY",
    "USUAL_MODEL",
    "BoolArray",
    "Calibration",
    "Capability",
    "Circumstances",
    "Excitation",
    "FloatArray",
    "Provenance",
    "Quantity",
    "Record",
    "ResponseTable",
    "SystematicEffect",
]

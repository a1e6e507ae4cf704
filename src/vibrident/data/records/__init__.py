"""Measured data in physical units, validated: records, tabulated responses, calibrations."""

from vibrident.data.effects import Capability, Circumstances, SystematicEffect
from vibrident.data.records.basis import (
    EXCITATIONS,
    MAX_CHANNEL_VALUE,
    MOTIONS,
    QUANTITIES,
    REFERENCE_UNITS,
    STANDARD_GRAVITY,
    STATIONARY_EXCITATIONS,
    USUAL_MODEL,
    BoolArray,
    Excitation,
    FloatArray,
    Provenance,
    Quantity,
    is_motion,
)
from vibrident.data.records.calibration import Calibration
from vibrident.data.records.record import Record, ResponseTable

__all__ = [
    "EXCITATIONS",
    "MAX_CHANNEL_VALUE",
    "MOTIONS",
    "QUANTITIES",
    "REFERENCE_UNITS",
    "STANDARD_GRAVITY",
    "STATIONARY_EXCITATIONS",
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
    "is_motion",
]

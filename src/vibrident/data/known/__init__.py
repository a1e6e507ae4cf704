"""Known responses of channels: complex, over frequency, with their uncertainty."""

from vibrident.data.known.mounting import Mounting
from vibrident.data.known.response import KnownResponse, refuse_known
from vibrident.data.known.shapes import (
    DigitalFilter,
    RationalResponse,
    Shape,
    Tabulated,
    flat_gain,
)

__all__ = [
    "DigitalFilter",
    "KnownResponse",
    "Mounting",
    "RationalResponse",
    "Shape",
    "Tabulated",
    "flat_gain",
    "refuse_known",
]

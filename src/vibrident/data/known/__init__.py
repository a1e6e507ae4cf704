"""Known responses of channels: complex, over frequency, with their uncertainty."""

from vibrident.data.known.mounting import Mounting
from vibrident.data.known.response import KnownResponse, refuse_known
from vibrident.data.known.shapes import DigitalFilter, RationalResponse, Shape, Tabulated

__all__ = [
    "DigitalFilter",
    "KnownResponse",
    "Mounting",
    "RationalResponse",
    "Shape",
    "Tabulated",
    "refuse_known",
]

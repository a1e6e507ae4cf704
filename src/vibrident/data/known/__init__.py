"""Known responses of channels: complex, over frequency, with their uncertainty."""

from vibrident.data.known.response import KnownResponse, refuse_known
from vibrident.data.known.shapes import DigitalFilter, PolesZeros, Shape, Tabulated

__all__ = ["DigitalFilter", "KnownResponse", "PolesZeros", "Shape", "Tabulated", "refuse_known"]

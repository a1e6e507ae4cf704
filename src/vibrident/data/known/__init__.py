"""What is known of a channel: its complex response over frequency, with its uncertainty."""

from vibrident.data.known.response import KnownResponse, refuse_known
from vibrident.data.known.shapes import DigitalFilter, PolesZeros, Shape, Tabulated

__all__ = ["DigitalFilter", "KnownResponse", "PolesZeros", "Shape", "Tabulated", "refuse_known"]

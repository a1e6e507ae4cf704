"""What the data say before any model: their quality, the tones in them, their nonparametric response. No JAX."""

from __future__ import annotations

from vibrident.fit.measure.bands import measure_bands
from vibrident.fit.measure.quality import Finding, screen
from vibrident.fit.measure.response import MeasuredResponse
from vibrident.fit.measure.tones import find_tones, measure_tones

__all__ = ["Finding", "MeasuredResponse", "find_tones", "measure_bands", "measure_tones", "screen"]

"""The nonparametric response: transforms, bands, tones, and the noise beside them. No JAX."""

from __future__ import annotations

from vibrident.fit.response.bands import measure_bands
from vibrident.fit.response.response import MeasuredResponse
from vibrident.fit.response.tones import find_tones, measure_tones

__all__ = ["MeasuredResponse", "find_tones", "measure_bands", "measure_tones"]

"""What is wrong with data before any model: overdriven, dead, cut or copied channels, clocks, drift and hum. No JAX."""

from __future__ import annotations

from vibrident.data.screening.quality import Finding, screen

__all__ = ["Finding", "screen"]

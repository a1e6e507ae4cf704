"""Screen data before any model: clipped, dead, cut or copied channels, wild and lost samples."""

from __future__ import annotations

from vibrident.data.screening.quality import Finding, screen

__all__ = ["Finding", "screen"]

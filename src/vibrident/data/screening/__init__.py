"""Screen data before any model: clipped, dead, cut or copied channels, wild and lost samples."""

from __future__ import annotations

from vibrident.data.screening.quality import ScreeningFinding, screen

__all__ = ["ScreeningFinding", "screen"]

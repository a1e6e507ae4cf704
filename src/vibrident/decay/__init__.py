"""Free decays: natural frequency and damping ratio without a reference, by NumPy and SciPy alone."""

from __future__ import annotations

from vibrident.decay.document import decays_alone, identify_decays, require_plain
from vibrident.decay.examine import Decays, examine

__all__ = ["Decays", "decays_alone", "examine", "identify_decays", "require_plain"]

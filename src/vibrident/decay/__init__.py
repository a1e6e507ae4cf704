"""Free decays: natural frequency and damping ratio without a reference, by NumPy and SciPy alone."""

from __future__ import annotations

from vibrident.decay.beside import DecayDeviation, decay_deviations, free_parts
from vibrident.decay.document import decays_alone, identify_decays, require_plain
from vibrident.decay.examine import Decays, examine

__all__ = [
    "DecayDeviation",
    "Decays",
    "decay_deviations",
    "decays_alone",
    "examine",
    "free_parts",
    "identify_decays",
    "require_plain",
]

"""Free decays: natural frequency and damping ratio without a reference, by NumPy and SciPy alone."""

from vibrident.decay.presence import decay_deviations, decays_alone, free_parts

__all__ = ["decay_deviations", "decays_alone", "free_parts"]

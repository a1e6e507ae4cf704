"""The lines of a real signal's discrete Fourier transform."""

from __future__ import annotations

import numpy as np

from vibrident.records import FloatArray


def line_frequencies(samples: int, sampling_rate_hz: float) -> FloatArray:
    """Frequency of each line in Hz, shape (samples // 2 + 1,).

    The line at zero is given the next one's: a reference in velocity has no response at zero, and an offset is fitted.
    """
    return np.maximum(np.arange(samples // 2 + 1), 1) * (sampling_rate_hz / samples)


def line_counts(samples: int) -> FloatArray:
    """How often each line counts in a sum over the whole transform, shape (samples // 2 + 1,): its conjugate too."""
    counts = np.full(samples // 2 + 1, 2.0)
    counts[0] = 1.0
    if samples % 2 == 0:
        counts[-1] = 1.0
    return counts

"""The spectrum of a displacement between the lines of its motion."""

from __future__ import annotations

import itertools

import numpy as np
from scipy import fft

from vibrident.interferometer.setting import BoolArray, FloatArray

PIECE = 4096  # samples of a piece
BANDS = 12  # bands of the spectrum
MEDIAN = float(np.log(2.0))  # median of an exponential distribution over its mean


def displacement_noise(values: FloatArray, valid: BoolArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Amplitude density between the lines, in bands: frequencies in Hz and m/√Hz, both shape (bands,).

    Medians over the lines of each band, of pieces under a window with low side lobes, so that a tone is in few lines.

    ``values``: shape (n,), m; ``valid``: shape (n,).
    """
    length = min(PIECE, values.shape[0])
    if length < 64:
        return np.zeros(0), np.zeros(0)
    window = np.blackman(length) ** 2
    whole = [s for s in range(0, values.shape[0] - length + 1, length) if valid[s : s + length].all()]
    if not whole:
        return np.zeros(0), np.zeros(0)
    whole = whole[:: max(len(whole) // 64, 1)]
    t = np.linspace(-1.0, 1.0, length)
    line = np.stack([np.ones(length), t])
    pieces = np.stack([values[s : s + length] for s in whole])
    pieces = pieces - (pieces @ np.linalg.pinv(line)) @ line
    power = np.abs(np.asarray(fft.rfft(pieces * window, axis=1))) ** 2 / (rate_hz * np.sum(window**2)) * 2.0
    lines = np.arange(power.shape[1]) * rate_hz / length
    edges = np.geomspace(4.0 * rate_hz / length, 0.4 * rate_hz, BANDS + 1)
    frequency, density = [], []
    for low, high in itertools.pairwise(edges):
        inside = (lines >= low) & (lines < high)
        if inside.any():
            frequency.append(float(np.sqrt(low * high)))
            density.append(float(np.sqrt(np.median(power[:, inside]) / MEDIAN)))
    return np.array(frequency), np.array(density)

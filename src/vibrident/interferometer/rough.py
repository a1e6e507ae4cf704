"""The frequency of a sine from a piece of its phase, to a few per cent: enough to say how many samples it needs."""

from __future__ import annotations

import numpy as np

from vibrident.interferometer.choice import Choice
from vibrident.interferometer.phase import Path, unwrapped
from vibrident.interferometer.setting import Held, Signals
from vibrident.interferometer.sine import peak

#: Samples looked at, and means of them that are made.
PIECE, MEANS = 1 << 20, 1 << 14


def rough_frequency(signals: Signals, choice: Choice) -> float:
    """Frequency of the motion, Hz; that of one period in the piece where the motion is slower."""
    samples = min(signals.samples, PIECE)
    piece = Held(signals.block(0, samples), signals.rate_hz)
    phase = np.concatenate(list(unwrapped(piece, choice.ellipse, (), Path())))
    every = max(samples // MEANS, 1)
    means = phase[: samples // every * every].reshape(-1, every).mean(axis=1)
    return peak(means, np.ones(means.shape[0], dtype=bool), signals.rate_hz / every)

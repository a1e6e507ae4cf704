"""Does a motion die away, as a free one does? A look at its power in pieces of time, before anything is fitted."""

from __future__ import annotations

import numpy as np
from scipy.signal.windows import hann

from vibrident.data.records import BoolArray, FloatArray

#: Pieces of time, and the fewest samples of each.
PIECES, MIN_SAMPLES = 16, 32
#: Lines of the pieces' spectra that are looked at, the strongest.
LINES = 5
#: Largest power of a piece over the smallest, of a motion that goes on.
MAX_RATIO = 2.0
#: Largest power of a line in a piece over the median of the pieces: noise exceeds it once in 10 000 records.
MAX_LINE_RATIO = 20.0
#: A line falls beyond so many standard deviations of its slope: Student's t of 14 degrees of freedom, a chance of 1e-3.
MIN_SLOPE = 4.5


def goes_on(response: FloatArray, valid: BoolArray) -> bool:
    """Tell whether a response is as large at the end of a record as throughout.

    The power of neither all of it nor one of its strongest lines differs from piece to piece, nor falls on the whole.

    Args:
        response: shape (samples,).
        valid: samples to look at, shape (samples,).
    """
    length = response.size // PIECES
    if length < MIN_SAMPLES or not valid.all():
        return False
    pieces = response[: PIECES * length].reshape(PIECES, length)
    moving = pieces - pieces.mean(axis=1, keepdims=True)
    power = np.sum(moving**2, axis=1)
    if not np.max(power) < MAX_RATIO * np.min(power):
        return False
    lines = np.abs(np.fft.rfft(moving * hann(length), axis=1)) ** 2
    lines = lines[:, np.argsort(np.max(lines, axis=0))[-LINES:]]
    if np.any(np.max(lines, axis=0) > MAX_LINE_RATIO * np.median(lines, axis=0)):
        return False
    time = np.linspace(-1.0, 1.0, PIECES)[:, None]
    level = np.log(np.maximum(lines, np.finfo(float).tiny))
    level -= level.mean(axis=0)
    slope = np.sum(time * level, axis=0) / np.sum(time**2)
    scatter = np.sqrt(np.sum((level - slope * time) ** 2, axis=0) / (PIECES - 2.0) / np.sum(time**2))
    return bool(np.all(slope > -MIN_SLOPE * scatter))

"""Tell whether a motion dies away, by its power in pieces of time, before anything is fitted."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray

#: Pieces of time, and the fewest samples of each.
PIECES = 16
MIN_SAMPLES = 32
#: Largest ratio of the powers of two pieces in a motion that is steady. Of one that goes on, the
#: largest in its second half is no further below the largest in its first.
MAX_RATIO = 2.0
#: Largest power of a line in a piece over the median of the pieces: noise hardly ever exceeds it.
MAX_LINE_RATIO = 60.0
#: The strongest line falls by at least this many standard deviations of its slope …
MIN_FALL = 4.0
#: … and by this share of its amplitude in half a record: leakage from other lines may change it.
MIN_CHANGE = 5e-3


def is_sustained(response: FloatArray, valid: BoolArray) -> bool:
    """Tell whether a response goes on: it is as large in the second half of a record as before.

    No line is far stronger in one piece than it mostly is, as one that dies away beside hum. Where
    the power is much the same from the first large piece on, the strongest line must not fall, as
    that of a hardly damped decay does. Where it is not, the motion must swell again, as beats,
    noise and modulated tones do.

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
    is_large = MAX_RATIO * power > np.max(power)
    first = int(np.argmax(is_large))
    half = PIECES // 2
    if MAX_RATIO * np.max(power[half:]) < np.max(power[:half]):
        return False
    lines = np.abs(np.fft.rfft(moving[first:] * np.hanning(length), axis=1)) ** 2
    if np.any(np.max(lines, axis=0) > MAX_LINE_RATIO * np.median(lines, axis=0)):
        return False
    if is_large[first:].all():
        return not _strongest_line_falls(response[first * length :])
    lowest_before = np.minimum.accumulate(power[first:])
    return bool(np.any(power[first:] > MAX_RATIO * lowest_before))


def _strongest_line_falls(response: FloatArray) -> bool:
    """Tell whether the amplitude of the strongest line falls with time, to first order."""
    samples = response.size
    window = np.hanning(samples)
    time = np.linspace(-1.0, 1.0, samples)
    motion = response - np.average(response, weights=window)
    power = np.abs(np.fft.rfft(motion * window)) ** 2
    peak = 2 + int(np.argmax(power[2:-1]))
    before, top, after = np.log(np.maximum(power[peak - 1 : peak + 2], np.finfo(float).tiny))
    peak_bin = peak + 0.5 * (before - after) / min(before - 2.0 * top + after, -np.finfo(float).eps)
    wave = np.exp(1j * np.pi * peak_bin * time)
    columns = np.stack([wave.real, wave.imag, time * wave.real, time * wave.imag], axis=1)
    inverse = np.linalg.inv(columns.T @ (window[:, None] * columns))
    cosine, sine, rising_cosine, rising_sine = amounts = inverse @ (columns.T @ (window * motion))
    squares = cosine**2 + sine**2
    direction = np.array([0.0, 0.0, cosine, sine]) / squares
    spread = inverse @ columns.T @ ((window**2)[:, None] * columns) @ inverse
    residual = motion - columns @ amounts
    variance = float(np.average(residual**2, weights=window)) * float(
        direction @ spread @ direction
    )
    fall = -float(cosine * rising_cosine + sine * rising_sine) / squares
    return fall > max(MIN_FALL * np.sqrt(variance), MIN_CHANGE)

"""Noise of a decay: whitened by an autoregression, with the significant tones as unknowns.

An autoregressive filter whitens samples from their own past alone. It needs no window and no
periodic record, so a decay that is far from periodic is weighted exactly (Kay, Modern Spectral
Estimation, 1988, ch. 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.autoregression import yule_walker

#: A tone is above this multiple of the levels around it; false alarms: e^-20 a line.
MIN_TONE_POWER = 20.0
#: Most tones of a record.
MAX_TONES = 8


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of a record.

    Attributes:
        whitening: coefficients of the prediction-error filter, the first of them one, shape (order
            + 1,).
        tones_hz: tones in the record that are not of the motion.
    """

    whitening: FloatArray
    tones_hz: tuple[float, ...] = ()

    def applied(self, columns: FloatArray) -> FloatArray:
        """Return columns, shape (samples, n), whitened; the first samples lack their past."""
        whitened = np.zeros_like(columns)
        for shift, coefficient in enumerate(self.whitening[: len(columns)]):
            whitened[shift:] += coefficient * columns[: len(columns) - shift]
        return whitened

    def rows(self, valid: BoolArray) -> BoolArray:
        """Return the samples whose whole past is valid, shape (samples,)."""
        order = len(self.whitening) - 1
        past_valid = valid.copy()
        past_valid[:order] = False
        for shift in range(1, order + 1):
            past_valid[shift:] &= valid[:-shift]
        return past_valid


WHITE = Noise(np.ones(1))


def tones_of(
    residual: FloatArray,
    rate_hz: float,
    skip_hz: tuple[float, float],
    known_hz: tuple[float, ...] = (),
) -> tuple[float, ...]:
    """Return the significant tones of a residual, after the known ones.

    Args:
        residual: shape (samples,); zero where it is not known.
        rate_hz: sampling rate.
        skip_hz: band in which a line is motion and no tone.
        known_hz: tones that are subtracted from the residual already.
    """
    remainder = np.array(residual)
    tones = []
    for _ in range(MAX_TONES - len(known_hz)):
        tone = _tone(remainder, rate_hz, skip_hz)
        if tone is None:
            break
        tones.append(_refined(remainder, tone, rate_hz))
        columns = tone_columns(tuple(tones), np.arange(remainder.size) / rate_hz)
        remainder = without_columns(residual, columns)
    return (*known_hz, *tones)


def without_columns(series: FloatArray, columns: FloatArray) -> FloatArray:
    """Return a series less its least-squares fit by columns, shape (samples, n)."""
    return series - columns @ np.linalg.lstsq(columns, series, rcond=None)[0]


def tone_columns(tones_hz: tuple[float, ...], time_s: FloatArray) -> FloatArray:
    """Return cosine and sine of each tone, shape (samples, 2 tones)."""
    angle = 2.0 * np.pi * np.outer(time_s, np.array(tones_hz))
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def _tone(residual: FloatArray, rate_hz: float, skip_hz: tuple[float, float]) -> float | None:
    """Return the frequency of a significant line, interpolated; None if no line is significant."""
    size = fast_length(2 * residual.size)
    width = 64
    power = np.abs(fft.rfft(residual * np.hanning(residual.size), size)) ** 2
    step = rate_hz / size
    if power.size < 4 * width:
        return None
    coarse = power[: power.size // width * width].reshape(-1, width)
    middle = (np.arange(len(coarse)) + 0.5) * width
    level = np.interp(np.arange(power.size), middle, np.median(coarse, axis=1) / np.log(2.0))
    ratio = power / np.maximum(level, np.finfo(float).tiny)
    frequency = np.arange(power.size) * step
    ratio[(frequency >= skip_hz[0] - 8 * step) & (frequency <= skip_hz[1] + 8 * step)] = 0.0
    ratio[:16] = 0.0
    ratio[-4:] = 0.0
    peak = int(np.argmax(ratio))
    if ratio[peak] < MIN_TONE_POWER:
        return None
    before, centre, after = np.sqrt(power[peak - 1 : peak + 2])
    return float(
        (peak + 0.5 * (after - before) / max(2.0 * centre - before - after, 1e-12 * centre)) * step
    )


def _refined(residual: FloatArray, tone_hz: float, rate_hz: float) -> float:
    """Return the frequency of a tone by least squares, Gauss-Newton from its line."""
    time = np.arange(residual.size) / rate_hz
    for _ in range(3):
        angle = 2.0 * np.pi * tone_hz * time
        cosine = np.cos(angle)
        sine = np.sin(angle)
        basis = np.stack([cosine, sine], axis=1)
        a, b = np.linalg.lstsq(basis, residual, rcond=None)[0]
        slope = 2.0 * np.pi * time * (b * cosine - a * sine)
        columns = np.column_stack([basis, slope])
        sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        step = np.linalg.lstsq(columns / sizes, residual, rcond=None)[0][2] / sizes[2]
        tone_hz += float(
            np.clip(step, -0.5 * rate_hz / residual.size, 0.5 * rate_hz / residual.size)
        )
    return tone_hz


def autoregression(residual: FloatArray) -> FloatArray:
    """Return the prediction-error filter of least BIC by the Yule-Walker equations."""
    count = residual.size
    max_order = min(64, count // 20)  # twenty samples for each order
    size = fast_length(2 * count)
    lags = fft.irfft(np.abs(fft.rfft(residual, size)) ** 2, size)[: max_order + 1] / count
    if lags[0] <= 0.0 or max_order < 1:
        return np.ones(1)
    return yule_walker(lags, count)[0]

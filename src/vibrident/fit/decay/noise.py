"""The noise beside a decay: whitened by an autoregression, with the significant tones as unknowns.

An autoregressive filter whitens samples from their own past alone. It needs no window and no record that closes on
itself, so a decay that is far from periodic is weighed exactly (Kay, Modern Spectral Estimation, 1988, ch. 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.autoregression import yule_walker

TONE_POWER = (
    20.0  # a tone is above this multiple of the levels around it; false alarms: e^-20 a line
)
MOST_TONES = 8  # most tones of a record


@dataclass(frozen=True, eq=False)
class Noise:
    """What whitens a record."""

    whitening: FloatArray  # coefficients of the prediction-error filter, the first of them one; shape (order + 1,)
    tones_hz: tuple[float, ...] = ()  # tones in the record beside the motion

    def applied(self, columns: FloatArray) -> FloatArray:
        """Columns, shape (samples, n), whitened; the first samples lack their past."""
        found = np.zeros_like(columns)
        for shift, coefficient in enumerate(self.whitening[: len(columns)]):
            found[shift:] += coefficient * columns[: len(columns) - shift]
        return found

    def rows(self, valid: BoolArray) -> BoolArray:
        """Samples whose whole past is valid, shape (samples,)."""
        order = len(self.whitening) - 1
        known = valid.copy()
        known[:order] = False
        for shift in range(1, order + 1):
            known[shift:] &= valid[:-shift]
        return known


WHITE = Noise(np.ones(1))


def tones_of(
    residual: FloatArray,
    rate_hz: float,
    skip_hz: tuple[float, float],
    known_hz: tuple[float, ...] = (),
) -> tuple[float, ...]:
    """Significant tones of a residual, after the known ones.

    ``residual``: shape (samples,); zero where it is not known; ``skip_hz``: band in which a line is motion and no tone;
    ``known_hz``: tones that were taken out already.
    """
    rest, tones = np.array(residual), []
    for _ in range(MOST_TONES - len(known_hz)):
        tone = _tone(rest, rate_hz, skip_hz)
        if tone is None:
            break
        tones.append(_refined(rest, tone, rate_hz))
        basis = tone_columns(tuple(tones), np.arange(rest.size) / rate_hz)
        rest = residual - basis @ np.linalg.lstsq(basis, residual, rcond=None)[0]
    return (*known_hz, *tones)


def tone_columns(tones_hz: tuple[float, ...], time_s: FloatArray) -> FloatArray:
    """Cosine and sine of each tone, shape (samples, 2 tones)."""
    angle = 2.0 * np.pi * np.outer(time_s, np.array(tones_hz))
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def _tone(residual: FloatArray, rate_hz: float, skip_hz: tuple[float, float]) -> float | None:
    """Frequency of a significant line, refined between the lines; None if no line is significant."""
    size, width = fast_length(2 * residual.size), 64
    power = np.abs(np.asarray(fft.rfft(residual * np.hanning(residual.size), size))) ** 2
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
    at = int(np.argmax(ratio))
    if ratio[at] < TONE_POWER:
        return None
    left, centre, right = np.sqrt(power[at - 1 : at + 2])
    return float(
        (at + 0.5 * (right - left) / max(2.0 * centre - left - right, 1e-12 * centre)) * step
    )


def _refined(residual: FloatArray, tone_hz: float, rate_hz: float) -> float:
    """Frequency of a tone by least squares, Gauss-Newton from its line."""
    time = np.arange(residual.size) / rate_hz
    for _ in range(3):
        angle = 2.0 * np.pi * tone_hz * time
        cosine, sine = np.cos(angle), np.sin(angle)
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
    """Prediction-error filter by the Yule-Walker equations, with the order of least BIC."""
    count = residual.size
    most = min(64, count // 20)  # twenty samples for each order
    size = fast_length(2 * count)
    lags = (
        np.asarray(fft.irfft(np.abs(np.asarray(fft.rfft(residual, size))) ** 2, size))[: most + 1]
        / count
    )
    if lags[0] <= 0.0 or most < 1:
        return np.ones(1)
    return yule_walker(lags, count)[0]

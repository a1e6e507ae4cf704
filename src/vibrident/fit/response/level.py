"""Noise power at a tone from the spectral lines around it.

A line of Gaussian noise has an exponentially distributed power. Three descriptions of its mean
compete by likelihood: the same at all lines; a power of the frequency (1/f noise, the foot of mains
hum); and, where the sensor's response is known, a + b |H|²: noise of the response channel, and
noise of the reference channel itself, which reaches Y − H X through H. The simplest is used unless
another is significantly better.

Where there is no motion beside the tone, the lines of each channel give a and b. In Y − H X one of
them can be hidden: noise of a displacement passes a sensor of acceleration with the square of the
frequency, and a record of a few periods has hardly a line in which the noise of the response could
be read.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray

ComplexArray = NDArray[np.complex128]

#: Weights of the lines fall as a normal curve of this width in the logarithm of frequency.
WEIGHT_WIDTH = 0.7
#: The logarithm of a periodogram line has the mean ln(level) − this.
LOG_BIAS = 0.5772156649
#: Its standard deviation.
LOG_DEVIATION = 1.2825
#: Neighbouring lines of a windowed spectrum are correlated, which widens statistics by this factor.
CORRELATION_FACTOR = 1.394
#: A slope counts beyond this many standard deviations.
MIN_SLOPE_DEVIATIONS = 4.0
#: Log-likelihood by which a + b |H|² must exceed one level (one more parameter: Akaike) …
MIN_SHAPE_GAIN = 1.0
#: … and a power law, which extrapolates further and needs better evidence.
MIN_LAW_GAIN = 2.0
#: The logarithm of a power law is within this distance of its value at the tone.
MAX_LAW_EXPONENT = 300.0
#: Shapes that differ by less than this fraction, in squares, are one: rounding.
MIN_SHAPE_VARIATION = 1e-14
#: Rounds of Fisher scoring for a + b |H|².
ROUNDS = 12
#: The noise of the channels does not explain Y − H X where the best a + b |H|² has a log-likelihood
#: larger by this.
MAX_MISFIT = 4.0
#: There is motion beside the tone where the channels correlate beyond so many deviations.
MAX_CORRELATION_DEVIATIONS = 3.0


def level_at_tone(
    power: FloatArray,
    ratio: FloatArray,
    weight: FloatArray,
    through: FloatArray | None = None,
    through_tone: FloatArray | None = None,
) -> FloatArray:
    """Return the mean noise power at each tone, shape (n,).

    Args:
        power: |line|², shape (n, K).
        ratio: frequency of each line over the tone's, shape (n, K).
        weight: one for a line, zero for padding, shape (n, K).
        through: |H|² at the lines, shape (n, K); None without a model.
        through_tone: |H|² at the tones, shape (n,).
    """
    law_weight = weight * np.exp(-0.5 * (np.log(np.maximum(ratio, 1e-6)) / WEIGHT_WIDTH) ** 2)
    scale = np.maximum(
        np.sum(weight * power, axis=1) / np.sum(weight, axis=1), np.finfo(float).tiny
    )
    power = power / scale[:, None]  # near one, so that the floors do not depend on the unit
    mean = np.sum(weight * power, axis=1) / np.sum(weight, axis=1)
    law, slope, significant = _power_law(power, ratio, weight, law_weight * (power > 0))
    if through is None or through_tone is None:
        return scale * np.where(significant, law, mean)
    shape_scale = np.maximum(np.max(weight * through, axis=1), 1e-300)
    shape = through / shape_scale[:, None]
    response_level, reference_level = _two_levels(power, shape, weight, mean)
    two_levels = response_level[:, None] + reference_level[:, None] * shape
    one_level = np.broadcast_to(mean[:, None], power.shape)
    # A few lines may have any slope.
    log_law = np.where(weight > 0.0, slope[:, None] * np.log(np.maximum(ratio, 1e-6)), 0.0)
    law_at_lines = law[:, None] * np.exp(np.clip(log_law, -MAX_LAW_EXPONENT, MAX_LAW_EXPONENT))
    shape_better = _gain(power, two_levels, one_level, weight) > MIN_SHAPE_GAIN
    level = np.where(
        shape_better, response_level + reference_level * through_tone / shape_scale, mean
    )
    rival = np.where(shape_better[:, None], two_levels, one_level)
    return scale * np.where(
        _gain(power, law_at_lines, rival, law_weight) > MIN_LAW_GAIN, law, level
    )


def level_by_channel(
    lines: tuple[ComplexArray, ComplexArray],
    gain: ComplexArray,
    at_tone: ComplexArray,
    ratio: FloatArray,
    weight: FloatArray,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the mean noise power of Y − H X by the noise of each channel, and where that holds.

    Args:
        lines: of the reference X and of the response Y, each of shape (n, K).
        gain: H at the lines, shape (n, K).
        at_tone: H at the tones, shape (n,).
        ratio: frequency of each line over the tone's, shape (n, K).
        weight: one for a line, zero for padding, shape (n, K).

    Returns:
        Both of shape (n,).
    """
    levels = []
    flat = np.ones(len(weight), dtype=bool)
    for line in lines:
        power = np.abs(line) ** 2
        levels.append(
            np.maximum(
                np.sum(weight * power, axis=1) / np.sum(weight, axis=1), np.finfo(float).tiny
            )
        )
        near = weight * np.exp(-0.5 * (np.log(np.maximum(ratio, 1e-6)) / WEIGHT_WIDTH) ** 2)
        flat &= ~_power_law(power / levels[-1][:, None], ratio, weight, near * (power > 0))[2]
    reference_level, response_level = levels
    through = np.abs(gain) ** 2
    scale = response_level + reference_level * np.max(weight * through, axis=1)
    power = np.abs(lines[1] - gain * lines[0]) ** 2 / scale[:, None]
    size = np.maximum(np.max(weight * through, axis=1), 1e-300)
    by_channel = (response_level[:, None] + reference_level[:, None] * through) / scale[:, None]
    mean = np.maximum(np.sum(weight * power, axis=1) / np.sum(weight, axis=1), np.finfo(float).tiny)
    a, b = _two_levels(power, through / size[:, None], weight, mean)
    best = a[:, None] + b[:, None] * through / size[:, None]
    fits = _gain(power, best, by_channel, weight) < MAX_MISFIT
    common = np.real(np.conj(gain * lines[0]) * lines[1]) / np.maximum(np.abs(gain), 1e-300)
    for slope in (0.0, 2.0):  # motion of one velocity or acceleration stands out at low frequencies
        emphasis = weight * np.maximum(ratio, 1e-6) ** -slope
        products = emphasis * np.abs(lines[0]) * np.abs(lines[1])
        spread = np.sqrt(0.5 * np.sum(products**2, axis=1))
        fits &= np.sum(
            emphasis * common, axis=1
        ) < MAX_CORRELATION_DEVIATIONS * CORRELATION_FACTOR * np.maximum(spread, 1e-300)
    return response_level + reference_level * np.abs(at_tone) ** 2, fits & flat


def _power_law(
    power: FloatArray, ratio: FloatArray, weight: FloatArray, law_weight: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Return level at the tone and slope of a power law through the lines, and its significance."""
    x = np.log(np.maximum(ratio, 1e-6))
    p = np.log(np.maximum(power, 1e-300))
    total = np.maximum(np.sum(law_weight, axis=1), 1e-300)
    x_mean = np.sum(law_weight * x, axis=1) / total
    p_mean = np.sum(law_weight * p, axis=1) / total
    dx = x - x_mean[:, None]
    spread = np.maximum(np.sum(law_weight * dx**2, axis=1), 1e-300)
    slope = np.sum(law_weight * dx * (p - p_mean[:, None]), axis=1) / spread
    slope_deviation = (
        LOG_DEVIATION
        * CORRELATION_FACTOR
        * np.sqrt(np.sum((law_weight * dx) ** 2, axis=1))
        / spread
    )
    # A tone below or above all its lines gets the value of the law at the nearest of them.
    line_positions = np.where(weight > 0, x, np.nan)
    nearest = np.clip(0.0, np.nanmin(line_positions, axis=1), np.nanmax(line_positions, axis=1))
    return (
        np.exp(p_mean + slope * (nearest - x_mean) + LOG_BIAS),
        slope,
        np.abs(slope) > MIN_SLOPE_DEVIATIONS * slope_deviation,
    )


def _two_levels(
    power: FloatArray, shape: FloatArray, weight: FloatArray, mean: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest a and b, neither negative, of the line means a + b·shape, each (n,).

    Fisher scoring with an identity link: least squares with weights 1/mean², refreshed.
    """
    fitted = np.repeat(mean[:, None], power.shape[1], axis=1)
    a = mean
    b = np.zeros_like(mean)
    tiny = 1e-12 * np.maximum(mean, 1e-288)[:, None]
    for _ in range(ROUNDS):
        w = weight / np.maximum(fitted, tiny) ** 2
        s0, s1, s2 = (np.sum(w * shape**k, axis=1) for k in range(3))
        p0 = np.sum(w * power, axis=1)
        p1 = np.sum(w * shape * power, axis=1)
        determinant = np.maximum(s0 * s2 - s1**2, MIN_SHAPE_VARIATION * s0 * s2 + 1e-300)
        a = (s2 * p0 - s1 * p1) / determinant
        b = (s0 * p1 - s1 * p0) / determinant
        a_without_b = p0 / s0
        b_without_a = p1 / np.maximum(s2, 1e-300)
        a = np.where(b < 0, a_without_b, a)
        b = np.where(b < 0, 0.0, b)
        b = np.where(a < 0, b_without_a, b)
        a = np.where(a < 0, 0.0, a)
        fitted = a[:, None] + b[:, None] * shape
    return a, b


def _gain(power: FloatArray, mean: FloatArray, rival: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the log-likelihood ratio of two means of exponentially distributed powers, shape (n,).

    Neighbouring lines of a windowed spectrum are not independent: their likelihood counts for less.
    """
    mean = np.maximum(mean, 1e-300)
    rival = np.maximum(rival, 1e-300)
    gains = weight * (np.log(rival / mean) + power / rival - power / mean)
    return np.sum(gains, axis=1) / CORRELATION_FACTOR**2

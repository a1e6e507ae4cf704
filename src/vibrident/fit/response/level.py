"""Noise power at a tone from the spectral lines around it.

A line of Gaussian noise has an exponentially distributed power. Three descriptions of its mean compete by likelihood:
the same at all lines; a power of the frequency (1/f noise, the foot of mains hum); and, where the sensor's response is
known, a + b |H|²: noise of the response channel beside noise of the reference channel itself, which
reaches Y − H X through H. The simplest is used unless another is significantly better.

Where no motion stands beside the tone, the channels' own lines give a and b, each from all of its lines. In Y − H X one
of them can be hidden: noise of a displacement passes a sensor of acceleration with the square of the frequency, and of
a record of a few periods hardly a line is left in which the response's own noise could be read.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray

ComplexArray = NDArray[np.complex128]

#: Lines count by their distance from the tone, a normal curve of this width in the logarithm of frequency.
NEAR = 0.7
#: The logarithm of a periodogram line has the mean ln(level) − this.
LOG_BIAS = 0.5772156649
#: Its standard deviation.
LOG_DEVIATION = 1.2825
#: Neighbouring lines of a windowed spectrum are correlated, which widens what is computed from them by this factor.
CORRELATED = 1.394
#: A slope counts beyond this many standard deviations.
SIGNIFICANT = 4.0
#: Log-likelihood by which a + b |H|² must be better than one level (one more parameter: Akaike).
ENOUGH_FOR_SHAPE = 1.0
#: … and a power law, which reaches further beyond its lines and needs better ones.
ENOUGH_FOR_LAW = 2.0
#: The logarithm of a power law is within so much of its value at the tone.
MOST_STEEP = 300.0
#: Shapes that differ by less than this part, in squares, are one: rounding.
ALIKE = 1e-14
#: Rounds of Fisher scoring for a + b |H|².
ROUNDS = 12
#: The channels' own noise does not explain Y − H X where the best a + b |H|² has a larger log-likelihood by this.
WORSE = 4.0
#: There is motion beside the tone where both channels correlate beyond so many standard deviations.
COHERENT = 3.0


def level_at_tone(
    power: FloatArray,
    ratio: FloatArray,
    weight: FloatArray,
    through: FloatArray | None = None,
    through_tone: FloatArray | None = None,
) -> FloatArray:
    """Mean noise power at each tone, shape (n,).

    Args:
        power: |line|², shape (n, K).
        ratio: frequency of each line over the tone's, shape (n, K).
        weight: one for a line, zero for padding, shape (n, K).
        through: |H|² at the lines, shape (n, K); None without a model.
        through_tone: |H|² at the tones, shape (n,).
    """
    near = weight * np.exp(-0.5 * (np.log(np.maximum(ratio, 1e-6)) / NEAR) ** 2)
    scale = np.maximum(
        np.sum(weight * power, axis=1) / np.sum(weight, axis=1), np.finfo(float).tiny
    )
    power = power / scale[:, None]  # near one: the floors below must not depend on the unit
    mean = np.sum(weight * power, axis=1) / np.sum(weight, axis=1)
    law, slope, sloped = _power_law(power, ratio, weight, near * (power > 0))
    if through is None or through_tone is None:
        return scale * np.where(sloped, law, mean)
    size = np.maximum(np.max(weight * through, axis=1), 1e-300)
    shape = through / size[:, None]
    own, passed = _two_levels(power, shape, weight, mean)
    two = own[:, None] + passed[:, None] * shape
    even = np.broadcast_to(mean[:, None], power.shape)
    steep = np.where(
        weight > 0.0, slope[:, None] * np.log(np.maximum(ratio, 1e-6)), 0.0
    )  # of a few lines, any slope
    along = law[:, None] * np.exp(np.clip(steep, -MOST_STEEP, MOST_STEEP))
    shaped = _gain(power, two, even, weight) > ENOUGH_FOR_SHAPE
    level = np.where(shaped, own + passed * through_tone / size, mean)
    rival = np.where(shaped[:, None], two, even)
    return scale * np.where(_gain(power, along, rival, near) > ENOUGH_FOR_LAW, law, level)


def levels_apart(
    lines: tuple[ComplexArray, ComplexArray],
    gain: ComplexArray,
    at_tone: ComplexArray,
    ratio: FloatArray,
    weight: FloatArray,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Mean noise power of Y − H X at each tone by the noise of each channel, and where that holds; both shape (n,).

    Args:
        lines: of the reference X and of the response Y, each of shape (n, K).
        gain: H at the lines, shape (n, K).
        at_tone: H at the tones, shape (n,).
        ratio: frequency of each line over the tone's, shape (n, K).
        weight: one for a line, zero for padding, shape (n, K).
    """
    own, flat = [], np.ones(len(weight), dtype=bool)
    for line in lines:
        power = np.abs(line) ** 2
        own.append(
            np.maximum(
                np.sum(weight * power, axis=1) / np.sum(weight, axis=1), np.finfo(float).tiny
            )
        )
        near = weight * np.exp(-0.5 * (np.log(np.maximum(ratio, 1e-6)) / NEAR) ** 2)
        flat &= ~_power_law(power / own[-1][:, None], ratio, weight, near * (power > 0))[2]
    passed, felt = own
    through = np.abs(gain) ** 2
    scale = felt + passed * np.max(weight * through, axis=1)
    power = np.abs(lines[1] - gain * lines[0]) ** 2 / scale[:, None]
    size = np.maximum(np.max(weight * through, axis=1), 1e-300)
    apart = (felt[:, None] + passed[:, None] * through) / scale[:, None]
    mean = np.maximum(np.sum(weight * power, axis=1) / np.sum(weight, axis=1), np.finfo(float).tiny)
    a, b = _two_levels(power, through / size[:, None], weight, mean)
    fits = _gain(power, a[:, None] + b[:, None] * through / size[:, None], apart, weight) < WORSE
    common = np.real(np.conj(gain * lines[0]) * lines[1]) / np.maximum(np.abs(gain), 1e-300)
    for steep in (0.0, 2.0):  # motion of one velocity or acceleration stands out at low frequencies
        at = weight * np.maximum(ratio, 1e-6) ** -steep
        spread = np.sqrt(0.5 * np.sum((at * np.abs(lines[0]) * np.abs(lines[1])) ** 2, axis=1))
        fits &= np.sum(at * common, axis=1) < COHERENT * CORRELATED * np.maximum(spread, 1e-300)
    return felt + passed * np.abs(at_tone) ** 2, fits & flat


def _power_law(
    power: FloatArray, ratio: FloatArray, weight: FloatArray, near: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Level at the tone and slope of the power law through the lines near it, and whether it is significant."""
    x = np.log(np.maximum(ratio, 1e-6))
    p = np.log(np.maximum(power, 1e-300))
    total = np.maximum(np.sum(near, axis=1), 1e-300)
    x_mean, p_mean = np.sum(near * x, axis=1) / total, np.sum(near * p, axis=1) / total
    dx = x - x_mean[:, None]
    spread = np.maximum(np.sum(near * dx**2, axis=1), 1e-300)
    slope = np.sum(near * dx * (p - p_mean[:, None]), axis=1) / spread
    doubt = LOG_DEVIATION * CORRELATED * np.sqrt(np.sum((near * dx) ** 2, axis=1)) / spread
    # A tone below or above all its lines gets the law at the nearest of them.
    inside = np.where(weight > 0, x, np.nan)
    nearest = np.clip(0.0, np.nanmin(inside, axis=1), np.nanmax(inside, axis=1))
    return (
        np.exp(p_mean + slope * (nearest - x_mean) + LOG_BIAS),
        slope,
        np.abs(slope) > SIGNIFICANT * doubt,
    )


def _two_levels(
    power: FloatArray, shape: FloatArray, weight: FloatArray, mean: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Maximum-likelihood a and b, neither negative, of the line means a + b·shape, each of shape (n,).

    Fisher scoring with an identity link: least squares with weights 1/mean², refreshed.
    """
    fitted = np.repeat(mean[:, None], power.shape[1], axis=1)
    a, b = mean, np.zeros_like(mean)
    tiny = 1e-12 * np.maximum(mean, 1e-288)[:, None]
    for _ in range(ROUNDS):
        w = weight / np.maximum(fitted, tiny) ** 2
        s0, s1, s2 = (np.sum(w * shape**k, axis=1) for k in range(3))
        p0, p1 = np.sum(w * power, axis=1), np.sum(w * shape * power, axis=1)
        determinant = np.maximum(s0 * s2 - s1**2, ALIKE * s0 * s2 + 1e-300)
        a, b = (s2 * p0 - s1 * p1) / determinant, (s0 * p1 - s1 * p0) / determinant
        alone_a, alone_b = p0 / s0, p1 / np.maximum(s2, 1e-300)
        a, b = np.where(b < 0, alone_a, a), np.where(b < 0, 0.0, b)
        a, b = np.where(a < 0, 0.0, a), np.where(a < 0, alone_b, b)
        fitted = a[:, None] + b[:, None] * shape
    return a, b


def _gain(
    power: FloatArray, better: FloatArray, than: FloatArray, weight: FloatArray
) -> FloatArray:
    """Log-likelihood ratio of two descriptions of exponentially distributed powers, shape (n,).

    Neighbouring lines of a windowed spectrum are not independent: their likelihood counts for less.
    """
    first, second = np.maximum(better, 1e-300), np.maximum(than, 1e-300)
    return (
        np.sum(weight * (np.log(second / first) + power / second - power / first), axis=1)
        / CORRELATED**2
    )

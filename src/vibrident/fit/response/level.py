"""Noise power at a tone from the spectral lines around it.

A line of Gaussian noise has an exponentially distributed power. Its mean is the sum of known
shapes, none negative: white noise, 1/f and 1/f² noise, and, where the sensor's response is known,
a share of |H|²: noise of the reference channel itself, which reaches Y − H X through H. Their
likeliest amounts give the level at the tone; without colour where that explains the lines as well.

Where there is no motion beside the tone, the lines of each channel give the noise of each. In
Y − H X one of them can be hidden: noise of a displacement passes a sensor of acceleration with the
square of the frequency, and a record of a few periods has hardly a line in which the noise of the
response could be read.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.likelihood import amounts_of

ComplexArray = NDArray[np.complex128]

#: Exponents of the frequency in the noise of a channel.
EXPONENTS = np.array([0.0, -1.0, -2.0])
#: The mean of lines within this ratio of the tone, on either side, is right to 3 % for each colour.
MIN_COLOUR_RATIO = 1.6
#: Log-likelihood by which colour must exceed white noise (two more parameters: Akaike 1974).
MIN_COLOUR_GAIN = 2.0
#: The noise of the channels explains Y − H X up to this excess of the likeliest level's
#: log-likelihood.
MAX_MISFIT = 4.0
#: There is motion beside the tone where the channels correlate by more standard deviations.
MAX_CORRELATION_DEVIATIONS = 3.0


def level_at_tone(
    lines: tuple[ComplexArray, ComplexArray],
    channels: Sequence[tuple[FloatArray, FloatArray]],
    gain: ComplexArray,
    at_tone: ComplexArray,
    ratio: FloatArray,
    weight: FloatArray,
) -> FloatArray:
    """Return the mean noise power of Y − H X at each tone, from that of the channels if it fits.

    Args:
        lines: of the reference X and of the response Y, each of shape (n, K).
        channels: the levels of each of them, at the lines and at the tones.
        gain: H at the lines, shape (n, K).
        at_tone: H at the tones, shape (n,).
        ratio: frequency of each line over the tone's, shape (n, K).
        weight: one for a line, zero for padding, shape (n, K).

    Returns:
        Shape (n,).
    """
    (reference, reference_at_tone), (response, response_at_tone) = channels
    through = np.abs(gain) ** 2
    through_tone = np.abs(at_tone) ** 2
    power = np.abs(lines[1] - gain * lines[0]) ** 2
    likeliest, likeliest_at_tone = levels(power, ratio, weight, through, through_tone)
    fits = _gain(power, likeliest, response + reference * through, weight) < MAX_MISFIT
    common = np.real(np.conj(gain * lines[0]) * lines[1]) / np.maximum(np.abs(gain), 1e-300)
    for slope in (0.0, 2.0):  # motion of one velocity or acceleration stands out at low frequencies
        emphasis = weight * np.maximum(ratio, 1e-6) ** -slope
        products = emphasis * np.abs(lines[0]) * np.abs(lines[1])
        spread = np.sqrt(0.5 * np.sum(products**2, axis=1))
        fits &= np.sum(emphasis * common, axis=1) < MAX_CORRELATION_DEVIATIONS * np.maximum(
            spread, 1e-300
        )
    return np.where(fits, response_at_tone + reference_at_tone * through_tone, likeliest_at_tone)


def levels(
    power: FloatArray,
    ratio: FloatArray,
    weight: FloatArray,
    through: FloatArray | None = None,
    through_tone: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest level at the lines, shape (n, K), and at the tones, shape (n,).

    A tone below or above all its lines gets the colour of the nearest of them.

    Args:
        power: |line|², shape (n, K).
        ratio: frequency of each line over the tone's, shape (n, K).
        weight: one for a line, zero for padding, shape (n, K).
        through: |H|² at the lines, shape (n, K); None without a model.
        through_tone: |H|² at the tones, shape (n,).
    """
    is_line = weight > 0.0
    lowest = np.min(np.where(is_line, ratio, np.inf), axis=1)
    highest = np.max(np.where(is_line, ratio, 0.0), axis=1)
    exponents = np.broadcast_to(EXPONENTS, (len(ratio), EXPONENTS.size))
    at_tone = np.clip(1.0, lowest, highest)[:, None] ** exponents
    shapes = np.where(is_line, ratio, 1.0)[:, None] ** exponents[:, :, None]
    is_coloured = EXPONENTS != 0.0
    if through is not None and through_tone is not None:
        size = np.maximum(np.max(weight * through, axis=1, keepdims=True), 1e-300)
        shapes = np.concatenate([shapes, (through / size)[:, None]], axis=1)
        at_tone = np.concatenate([at_tone, through_tone[:, None] / size], axis=1)
        is_coloured = np.append(is_coloured, False)
    # Padding takes the mean of the others, on which the start of the search depends.
    means = np.mean(shapes, axis=2, keepdims=True, where=is_line[:, None])
    shapes = np.where(is_line[:, None], shapes, means)

    def likeliest(rows: BoolArray, used: BoolArray) -> tuple[FloatArray, FloatArray]:
        rows_shapes = shapes[np.ix_(rows, used)]
        if rows_shapes.shape[1] == 1:
            total = np.sum(weight[rows], axis=1, keepdims=True)
            amounts = np.sum(weight[rows] * power[rows], axis=1, keepdims=True) / total
        else:
            amounts = amounts_of(rows_shapes, power[rows, None], weight[rows, None]).values[:, 0]
        level = (amounts[:, None] @ rows_shapes)[:, 0]
        return level, np.sum(amounts * at_tone[np.ix_(rows, used)], axis=1)

    level, tone_level = likeliest(np.ones(len(ratio), dtype=bool), ~is_coloured)
    wide = np.maximum(highest, 1.0 / lowest) > MIN_COLOUR_RATIO
    if np.any(wide):
        coloured, coloured_at_tone = likeliest(wide, np.ones_like(is_coloured))
        gain = _gain(power[wide], coloured, level[wide], weight[wide])
        better = gain > MIN_COLOUR_GAIN
        level[wide] = np.where(better[:, None], coloured, level[wide])
        tone_level[wide] = np.where(better, coloured_at_tone, tone_level[wide])
    return level, tone_level


def _gain(power: FloatArray, mean: FloatArray, rival: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the log-likelihood ratio of two means of exponentially distributed powers, (n,)."""
    mean = np.maximum(mean, 1e-300)
    rival = np.maximum(rival, 1e-300)
    gains = weight * (np.log(rival / mean) + power / rival - power / mean)
    return np.asarray(np.sum(gains, axis=1))

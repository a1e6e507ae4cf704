"""The spectrum of a record's residual: how much noise stands at each line, and how much of it came by the reference.

White and 1/f noise of the response, and noise σx² of the reference that the sensor did not feel; it passes the model:

    S(f) = a + c/f + σx² |H(f)|²

by likelihood; what other shape there is comes on top as the mean of the residual's periodogram over the lines around,
relative to this. Lines that stand far above it (mains hum) are taken as they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from vibrident.estimators.covariance import inverse_normal
from vibrident.measure.response import ComplexArray
from vibrident.records import BoolArray, FloatArray

#: Bins that a spectrum is averaged into, and the part of the sampling rate up to which it is looked at.
BINS, HIGHEST = 160, 0.4
#: Multiplicative updates of the three levels.
ROUNDS = 150
#: σx² is believed beyond this many standard deviations; the doubt left is this many.
SIGNIFICANT, DOUBT = 4.0, 2.0
#: Levels below this part of the mean are not believed.
LEAST_LEVEL = 1e-12
#: Lines averaged on either side of each for the weights, a part of the spectrum and fewest; the nearest are left out.
SHARE, FEWEST, NEAREST = 1 / 64, 24, 2
#: A line this many times above its surroundings is no chance: one of 10⁹ white ones is.
OUTSTANDING = 20.0
#: A line this many times above its surroundings is a tone, and the most tones that are looked for.
TONE, TONES = 25.0, 16
#: Lines beyond this many times their surroundings are left out of the mean (one of 400 white ones is: allowed for).
FAR = 6.0


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Noise at the lines of a residual's real transform; one is white noise of unit variance.

    Attributes:
        level: shape (samples // 2 + 1,).
        passed: σx², where it is believed, in squares of what the residual is measured in per |H|²; zero elsewhere.
        passed_at: the same at each line: its share of the level there, shape (samples // 2 + 1,).
        doubt: σx² that may be left beside it.
        tones: where a tone stands in the residual (mains hum), in lines and parts of one.
    """

    level: FloatArray
    passed: float
    passed_at: FloatArray
    doubt: float
    tones: tuple[float, ...] = ()


def noise_spectrum(
    lines: ComplexArray, count: float, through: FloatArray | None, predicted: FloatArray, floor: float
) -> NoiseSpectrum:
    """Read the spectrum of a residual.

    Args:
        lines: the residual's real transform, shape (samples // 2 + 1,).
        count: number of samples that are used.
        through: |H|² at the lines; None without a reference.
        predicted: power of the response that the model predicts, at the lines: where that has a line of its own, a
            remainder is the model's and no hum.
        floor: level that no residual is believed to be below.
    """
    power = np.abs(lines) ** 2 / count
    passed, doubt = 0.0, 0.0
    if through is None:
        shape = np.ones_like(power)
    else:
        edges = _bins(2 * (len(power) - 1))
        wide = np.diff(edges).astype(float)
        # Geometric means: a tone that is not quite fitted, or hum, is not the noise looked for. That of n exponentially
        # distributed powers has the mean Γ(1 + 1/n)ⁿ times theirs.
        level = _means(power, edges) * np.exp(-wide * gammaln(1.0 + 1.0 / wide))
        order, seen = _means(np.arange(len(power), dtype=float), edges), _means(through, edges)
        shapes = np.stack([np.ones_like(order), order[0] / order, np.maximum(seen / np.max(seen), LEAST_LEVEL)])
        amounts, spread = _levels(shapes, level, wide)
        scale = float(np.max(seen))
        variance, spread = amounts[2] / scale, spread / scale
        sure = variance > SIGNIFICANT * spread
        passed = variance if sure else 0.0
        doubt = min(DOUBT * spread if sure else variance + DOUBT * spread, float(np.min(level / seen)))
        all_lines = np.maximum(np.arange(len(power)), 1.0)
        shape = amounts[0] + amounts[1] * order[0] / all_lines + variance * through
        shape = np.maximum(shape, LEAST_LEVEL * float(np.average(level, weights=wide)))
    around = max(int(len(power) * SHARE), FEWEST)
    relative = power / shape
    capped = np.minimum(relative, OUTSTANDING * np.exp(np.mean(np.log(relative + 1e-300)) + np.euler_gamma))
    smooth = mean_around(capped, around, NEAREST)
    ordinary = np.where(relative < FAR * smooth, relative, smooth)
    smooth = mean_around(ordinary, around, NEAREST) / (1.0 - FAR * np.exp(-FAR))
    alone = predicted > OUTSTANDING * mean_around(predicted, around, NEAREST)
    hum = (relative > OUTSTANDING * smooth) & ~alone
    level = shape * np.where(hum, relative, smooth)
    tones = _tones(lines, TONE * shape * smooth * count, alone)
    return NoiseSpectrum(np.maximum(level, floor), passed, passed * smooth, doubt, tones)


def _tones(lines: ComplexArray, least: FloatArray, alone: BoolArray) -> tuple[float, ...]:
    """Places of lines that stand out so far that their skirts hide others, the strongest first."""
    power = np.zeros(lines.shape)  # under Hann's window, which is three lines
    power[1:-1] = np.abs(0.5 * lines[1:-1] - 0.25 * (lines[:-2] + lines[2:])) ** 2 / 0.375
    peak = np.zeros(power.shape, dtype=bool)
    peak[2:-2] = (power[2:-2] >= power[1:-3]) & (power[2:-2] > power[3:-1])
    peak &= (power > least) & ~alone
    places = np.flatnonzero(peak)
    places = places[np.argsort(-power[places])][:TONES]
    low, middle, high = (np.log(power[places + shift]) for shift in (-1, 0, 1))
    return tuple((places + 0.5 * (low - high) / (low - 2.0 * middle + high)).tolist())


def mean_around(power: FloatArray, width: int, nearest: int) -> FloatArray:
    """Mean over ``width`` lines on either side, the ``nearest`` and the line itself left out; mirrored at the ends."""
    width = min(width, power.size - 2)
    padded = np.concatenate([power[width:0:-1], power, power[-2 : -width - 2 : -1]])
    total = np.concatenate([[0.0], np.cumsum(padded)])
    centre = np.arange(power.size) + width

    def within(reach: int) -> FloatArray:
        return total[centre + reach + 1] - total[centre - reach]

    return (within(width) - within(nearest)) / (2.0 * (width - nearest))


def _bins(samples: int) -> NDArray[np.int_]:
    """First lines of the bins, and the line behind the last."""
    last = max(int(HIGHEST * samples), 8)
    return np.unique(np.round(np.geomspace(1, last + 1, BINS)).astype(int))


def _means(values: FloatArray, edges: NDArray[np.int_]) -> FloatArray:
    """Geometric means over bins."""
    total = np.add.reduceat(np.log(np.maximum(values[: edges[-1]], 1e-300)), edges[:-1])
    return np.maximum(np.exp(total / np.diff(edges)), 1e-300)


def _levels(shapes: FloatArray, level: FloatArray, count: FloatArray) -> tuple[FloatArray, float]:
    """Amounts of three shapes, and the standard deviation of the last, by likelihood.

    Means of exponentially distributed lines; multiplicative updates keep the three levels positive (Févotte, Bertin &
    Durrieu 2009); the deviation is from Fisher's information.
    """
    size = float(np.average(level, weights=count))
    level = np.maximum(level / size, LEAST_LEVEL)
    amounts = np.full(3, 1.0 / 3.0)
    for _ in range(ROUNDS):
        fitted = amounts @ shapes
        amounts = amounts * (shapes @ (count * level / fitted**2)) / (shapes @ (count / fitted))
    fitted = amounts @ shapes
    information = (shapes * (count / fitted**2)) @ shapes.T
    # A level at its bound is no unknown: it cannot hide the others.
    free = amounts > 1e-6 * np.max(amounts)
    free[2] = True
    spread = float(np.sqrt(inverse_normal(information[np.ix_(free, free)])[-1, -1]))
    return size * amounts, size * spread

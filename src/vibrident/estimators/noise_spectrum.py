"""The spectrum of a record's residual: the noise at each line, and the part of it from the reference.

White and 1/f noise of the response, and noise σx² of the reference channel itself; it passes the model:

    S(f) = a + c/f + σx² |H(f)|²

by likelihood; what other shape there is comes on top as the mean of the residual's periodogram over the lines around,
relative to this. Lines far above it (mains hum) are used unchanged.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.information import inverse_normal
from vibrident.measure.lines import in_blocks, mean_around, power_of
from vibrident.measure.response import ComplexArray
from vibrident.records import BoolArray, FloatArray

#: Bins that a spectrum is averaged into.
BINS = 160
#: Part of the sampling rate up to which a spectrum is looked at.
HIGHEST = 0.4
#: Multiplicative updates of the three levels.
ROUNDS = 150
#: σx² is significant above this many standard deviations.
SIGNIFICANT = 4.0
#: The remaining uncertainty of σx² is this many standard deviations.
DOUBT = 2.0
#: A line is without motion where the prediction is less than so many times what noise makes there.
QUIET = 4.0
#: So many lines must be without motion.
FEWEST_QUIET = 48
#: Fewest lines for a level.
MANY = 16
#: Lines count where the prediction is more than so many times the residual's level.
FAINT = 2.0
#: Lower limit of levels, relative to the mean.
LEAST_LEVEL = 1e-12
#: Lines averaged on either side of each for the weights: this part of the spectrum …
SHARE = 1 / 64
#: … and at least so many …
FEWEST = 24
#: … of which the nearest are left out.
NEAREST = 2
#: Variance of a mean over powers of lines under Hann's window, over that of independent lines.
ALIKE = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)
#: A line this many times above its surroundings is no chance: one of 10⁹ white ones is.
OUTSTANDING = 20.0
#: A line this many times above its surroundings is a tone.
TONE = 25.0
#: The most tones that are looked for.
TONES = 16
#: Lines beyond this many times their surroundings are left out of the mean (one of 400 white ones is: allowed for).
FAR = 6.0


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Noise at the lines of a residual's real transform; one is white noise of unit variance.

    Attributes:
        level: shape (samples // 2 + 1,).
        passed: σx² if it is significant, in squares of the residual's unit per |H|²; else zero.
        passed_at: the same at each line: its share of the level there, shape (samples // 2 + 1,).
        doubt: makes σx² that may be left beside it (95 %) at each line, shape (samples // 2 + 1,).
        excited: weight of each line, shape (samples // 2 + 1,): zero where noise of the reference alone could explain
            the prediction.
        tones: places of tones in the residual (mains hum), in lines and fractions of one.
        free: whether the motion leaves lines free, in which noise of the reference would show.
    """

    level: FloatArray
    passed: float
    passed_at: FloatArray
    doubt: Callable[[], FloatArray]
    excited: FloatArray
    tones: tuple[float, ...] = ()
    free: bool = False


@dataclass(frozen=True, eq=False)
class Motion:
    """The model's prediction of a record, for the analysis of the residual's spectrum.

    Attributes:
        count: number of samples that are used.
        predicted: makes its real transform, or some lines of it, shape (lines,).
        through: |H|² at the lines of the real transform, shape (samples // 2 + 1,); None without a reference.
        alone: where the prediction has a line of its own: a remainder there is the model's and no hum.
        own: power of the prediction, smoothed except at outstanding lines, shape (samples // 2 + 1,).
        seen: |H|² in bins, shape (bins,).
    """

    count: float
    predicted: Callable[[slice], ComplexArray]
    through: FloatArray | None
    alone: BoolArray
    own: FloatArray
    seen: FloatArray

    @classmethod
    def of(cls, predicted: ComplexArray, count: float, through: FloatArray | None) -> Motion:
        """Of the prediction's real transform, shape (samples // 2 + 1,)."""
        around, expected = _around(predicted), power_of(predicted)
        alone = expected > OUTSTANDING * mean_around(expected, around, NEAREST)
        if through is None:
            nothing = np.zeros(0)
            return cls(count, predicted.__getitem__, None, alone, nothing, nothing)
        expected /= count
        own = _typical(expected, around)
        own = np.where(expected > OUTSTANDING * own, expected, own)
        return cls(count, predicted.__getitem__, through, alone, own, _means(through, _bins_of(len(expected)).edges))


def noise_spectrum(lines: ComplexArray, motion: Motion, floor: float) -> NoiseSpectrum:
    """Read the spectrum of a residual.

    Args:
        lines: the residual's real transform, shape (samples // 2 + 1,).
        motion: what the model says of the same record.
        floor: lower limit of the residual's level.
    """
    power = power_of(lines)
    power /= motion.count
    parts = _parts(lines, power, motion)
    shape = parts.shape
    relative = np.divide(power, shape, out=power)
    smooth = _surroundings(relative)
    hum = (relative > OUTSTANDING * smooth) & ~motion.alone
    tones = _tones(lines, TONE * shape * smooth * motion.count, motion.alone)
    level = np.maximum(shape * np.where(hum, relative, smooth), floor)
    excited = np.broadcast_to(1.0, level.shape)
    if motion.through is not None:  # by how much the prediction stands above what noise of the reference would be
        excited = np.maximum(1.0 - FAINT * level / np.maximum(motion.own, 1e-300), 0.0)
    passed_at = parts.unfelt * smooth if parts.passed > 0.0 else np.broadcast_to(0.0, level.shape)
    return NoiseSpectrum(level, parts.passed, passed_at, parts.doubt, excited, tones, parts.free)


class _Parts(NamedTuple):
    """White and 1/f noise of the response, and that of the reference.

    Attributes:
        shape: their sum at each line, shape (lines,).
        passed: σx² if it is significant; else zero.
        unfelt: the same at each line, a number or shape (lines,).
        doubt: makes σx² that may be left beside it (95 %) at each line, shape (lines,).
        free: whether enough lines hold no motion.
    """

    shape: FloatArray
    passed: float
    unfelt: FloatArray | float
    doubt: Callable[[], FloatArray]
    free: bool


def _parts(lines: ComplexArray, power: FloatArray, motion: Motion) -> _Parts:
    through = motion.through
    if through is None:
        return _Parts(np.ones_like(power), 0.0, 0.0, functools.partial(np.broadcast_to, 0.0, power.shape), False)
    edges, wide, order, geometric = _bins_of(len(power))
    level, seen = _means(power, edges) * geometric, motion.seen
    shapes = np.stack([np.ones_like(order), order[0] / order, np.maximum(seen / np.max(seen), LEAST_LEVEL)])
    amounts, spread = _levels(shapes, level, wide)
    scale = float(np.max(seen))
    variance, spread = amounts[2] / scale, spread / scale
    sure = variance > SIGNIFICANT * spread
    # All of the level at most; a bin of a few lines is low by chance.
    whole = (level / seen * (1.0 + DOUBT / np.sqrt(wide)))[wide >= min(MANY, np.max(wide))]
    most = min(DOUBT * spread if sure else variance + DOUBT * spread, float(np.min(whole)))
    passed = unfelt = variance if sure else 0.0
    doubt: Callable[[], FloatArray] = functools.partial(np.broadcast_to, most, power.shape)
    told = _unfelt(lines, motion, through, int(edges[-1]))
    by_reference = amounts[2] / scale * through
    if told.passed > 0.0:
        passed, doubt, unfelt, by_reference = told.passed, told.doubt, told.at_lines, told.at_lines * through
        amounts = _beside(shapes[:2], level, wide, _means(by_reference, edges))
    elif not sure and told.spread < spread:
        doubt = told.doubt
    all_lines = np.maximum(np.arange(len(power)), 1.0)
    shape = amounts[0] + amounts[1] * order[0] / all_lines + by_reference
    shape = np.maximum(shape, LEAST_LEVEL * float(np.average(level, weights=wide)))
    return _Parts(shape, passed, unfelt, doubt, told.free)


def _surroundings(relative: FloatArray) -> FloatArray:
    """Mean over the lines around each, without those that stand out."""
    around = _around(relative)
    capped = np.minimum(relative, OUTSTANDING * np.exp(np.mean(np.log(relative + 1e-300)) + np.euler_gamma))
    smooth = mean_around(capped, around, NEAREST)
    ordinary = np.where(relative < FAR * smooth, relative, smooth)
    return mean_around(ordinary, around, NEAREST) / (1.0 - FAR * np.exp(-FAR))


def _around(lines: ComplexArray | FloatArray) -> int:
    """Lines on either side that a level is averaged over."""
    return max(int(len(lines) * SHARE), FEWEST)


@dataclass(frozen=True, eq=False)
class _Unfelt:
    """Noise of the reference, estimated mainly from lines without motion.

    Attributes:
        variance: mean of σx² over the lines.
        spread: its standard deviation.
        passed: the variance if it is significant; else zero.
        doubt: makes σx² that may be left beside it (95 %) at each line, shape (lines,).
        at_lines: σx² at each line, shape (lines,).
        free: whether enough lines hold no motion.
    """

    variance: float
    spread: float
    passed: float
    doubt: Callable[[], FloatArray]
    at_lines: FloatArray
    free: bool


def _unfelt(rest: ComplexArray, motion: Motion, through: FloatArray, last: int) -> _Unfelt:
    """Noise of the reference by what residual and prediction have in common.

    Noise n of the reference appears in the prediction as H n and in the residual as −H n, so −Re Ŷ* R has the mean
    |H|² σx². Lines without excitation determine it best, and each line is weighted by its scatter with motion. An
    error of the model gives a share of |Ŷ|², with a slope in f². White and 1/f noise are
    separated.
    """
    around, order, share = _around(through), np.arange(1, last) / last, through[1:last]
    common, left, power = np.empty((3, last - 1))
    for part in in_blocks(last - 1):  # of a long record each copy counts
        beside = slice(part.start, part.stop + 2)
        kept, moved = (_windowed(lines) for lines in (rest[beside], motion.predicted(beside)))
        common[part] = -(moved.real * kept.real + moved.imag * kept.imag) / motion.count
        left[part], power[part] = power_of(kept) / motion.count, power_of(moved) / motion.count
    left, own = _typical(left, around), _typical(power, around)
    ordinary, found = power < FAR * own, np.zeros(4)
    del power
    for _ in range(2):
        sums = np.zeros((4, 5))
        for part in in_blocks(last - 1):
            bent, steep = order[0] / order[part], order[part] ** 2
            rows = np.stack([share[part], share[part] * bent, own[part], own[part] * steep, common[part]])
            variance = 0.5 * (own[part] * left[part] + (found[:2] @ rows[:2]) ** 2)
            sums += (rows[:4] * (ordinary[part] / np.maximum(variance, 1e-300) / ALIKE)) @ rows.T
        found, covariance, normal = _amounts(sums[:, :4], sums[:, 4])
    noise = share * (found[0] + found[1] * (order[0] / order))
    whole = inverse_normal(normal)
    mean = np.array([1.0, float(np.mean(order[0] / order))])
    total, spread = float(mean @ found[:2]), float(np.sqrt(mean @ covariance[:2, :2] @ mean))
    free = bool(np.sum(own < QUIET * left) >= FEWEST_QUIET)
    if np.sum(own < QUIET * np.maximum(noise, left)) < FEWEST_QUIET:
        spread = np.inf  # motion everywhere: an error of the model cannot be separated from noise
    sure = total > SIGNIFICANT * spread
    flicker = functools.partial(_flicker, len(through), last)
    # Flicker noise may be present even if it is not significant.
    doubt = functools.partial(_doubt, flicker, whole, np.zeros(2) if sure else found)
    if sure:
        return _Unfelt(total, spread, total, doubt, found[0] + found[1] * flicker(), free)
    return _Unfelt(total, spread, 0.0, doubt, np.zeros(0), free)


def _flicker(lines: int, last: int) -> FloatArray:
    """1/f at each line, one at the first of ``last`` lines."""
    return (1.0 / last) / (np.maximum(np.arange(lines), 1.0) / last)


def _doubt(flicker: Callable[[], FloatArray], whole: FloatArray, found: FloatArray) -> FloatArray:
    """What was found of white and 1/f noise, and its uncertainty, at each line."""
    shape = flicker()
    around_it = whole[0, 0] + 2.0 * whole[0, 1] * shape + whole[1, 1] * shape**2
    return (found[0] + found[1] * shape) + DOUBT * np.sqrt(np.maximum(around_it, 0.0))


def _typical(values: FloatArray, around: int) -> FloatArray:
    """Level of exponentially distributed values, from the logarithms around: a few strong ones do not count."""
    return np.exp(mean_around(np.log(np.maximum(values, 1e-300)), around, NEAREST) + np.euler_gamma)


def _amounts(normal: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Least squares by its normal equations: the amounts, their covariance, and the normal matrix of all columns.

    The first two amounts are not negative; the second is left out if it is not significant.
    """
    scale, number = np.sqrt(np.maximum(np.diag(normal), 1e-300)), np.arange(len(right))
    normal, right = normal / np.outer(scale, scale), right / scale
    amounts, covariance = np.zeros(len(right)), np.zeros_like(normal)
    for free in (number, np.delete(number, 1)):
        inverse = inverse_normal(normal[np.ix_(free, free)])
        amounts[:], covariance[:] = 0.0, 0.0
        amounts[free], covariance[np.ix_(free, free)] = inverse @ right[free], inverse
        if amounts[0] >= 0.0 and amounts[1] > SIGNIFICANT * np.sqrt(covariance[1, 1]):
            break
    amounts[:2] = np.maximum(amounts[:2], 0.0)
    size = np.outer(scale, scale)
    return amounts / scale, covariance / size, normal * size


def _windowed(lines: ComplexArray) -> ComplexArray:
    """Lines under Hann's window, a sum of three, scaled to the same noise; without the first and the last."""
    return (0.5 * lines[1:-1] - 0.25 * (lines[:-2] + lines[2:])) / np.sqrt(0.375)


def _tones(lines: ComplexArray, least: FloatArray, alone: BoolArray) -> tuple[float, ...]:
    """Places of lines so strong that their leakage hides others, the strongest first."""
    power = np.zeros(lines.size)
    for part in in_blocks(lines.size - 2):
        power[part.start + 1 : part.stop + 1] = power_of(_windowed(lines[part.start : part.stop + 2]))
    peak = np.zeros(power.shape, dtype=bool)
    peak[2:-2] = (power[2:-2] >= power[1:-3]) & (power[2:-2] > power[3:-1])
    peak &= (power > least) & ~alone
    places = np.flatnonzero(peak)
    places = places[np.argsort(-power[places])][:TONES]
    low, middle, high = (np.sqrt(power[places + shift]) for shift in (-1, 0, 1))
    beside = np.maximum(low, high) / middle
    # Between two lines, as Hann's window has it: a parabola would be off by up to two hundredths of a line.
    offset = np.clip((2.0 * beside - 1.0) / (1.0 + beside), 0.0, 0.5)
    return tuple((places + np.where(high > low, offset, -offset)).tolist())


class _Bins(NamedTuple):
    """Bins of the lines of a real transform.

    Attributes:
        edges: first lines of the bins, and the line behind the last, shape (bins + 1,).
        wide: number of lines of each, shape (bins,).
        order: mean number of its lines.
        geometric: mean of so many exponentially distributed powers over their geometric mean, Γ(1 + 1/n)⁻ⁿ. The latter
            is what is taken: a tone that is not quite fitted, or hum, is not the noise looked for.
    """

    edges: NDArray[np.int_]
    wide: FloatArray
    order: FloatArray
    geometric: FloatArray


@functools.lru_cache(maxsize=8)
def _bins_of(lines: int) -> _Bins:
    last = max(int(HIGHEST * 2 * (lines - 1)), 8)
    edges = np.unique(np.round(np.geomspace(1, last + 1, BINS)).astype(int))
    wide = np.diff(edges).astype(float)
    order = _means(np.arange(lines, dtype=float), edges)
    return _Bins(edges, wide, order, np.exp(-wide * [math.lgamma(1.0 + 1.0 / number) for number in wide]))


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
    fitted, (up, down), across = amounts @ shapes, (both := np.empty((2, len(level)))), np.ascontiguousarray(shapes.T)
    for _ in range(ROUNDS):
        np.divide(count, fitted, out=down)
        np.multiply(down, level, out=up)
        up /= fitted
        more, less = both.dot(across)
        amounts *= more / less
        np.dot(amounts, shapes, out=fitted)
    information = (shapes * (count / fitted**2)) @ shapes.T
    # 1/f noise at its bound is no unknown: it cannot hide the others. White noise of the response can.
    free = amounts > 1e-6 * np.max(amounts)
    free[[0, 2]] = True
    spread = float(np.sqrt(inverse_normal(information[np.ix_(free, free)])[-1, -1]))
    return size * amounts, size * spread


def _beside(shapes: FloatArray, level: FloatArray, count: FloatArray, known: FloatArray) -> FloatArray:
    """Amounts of shapes beside what is known, by likelihood; as :func:`_levels`."""
    amounts = np.full(len(shapes), 0.1 * float(np.average(level, weights=count)))
    for _ in range(ROUNDS):
        fitted = amounts @ shapes + known
        amounts = amounts * (shapes @ (count * level / fitted**2)) / (shapes @ (count / fitted))
    return amounts

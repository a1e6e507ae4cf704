"""The spectrum of a record's residual: the noise at each line, and the part of it from the reference.

White and 1/f noise of the response, and noise σx² of the reference channel itself; it passes the model:

    S(f) = a + c/f + σx² g(f) |H(f)|²

by likelihood, with g one for white noise and ∝ f⁴ for an acceleration made of a displacement; what other shape there is
comes on top as the mean of the residual's periodogram over the lines around, relative to this. Lines far above it
(mains hum) are used unchanged.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.information import inverse_normal
from vibrident.fit.noise.incoherent import incoherent
from vibrident.fit.noise.motion import (
    FAR,
    NEAREST,
    OUTSTANDING,
    Motion,
    bins_of,
    lines_around,
    means,
    typical,
    windowed,
)
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import in_blocks, mean_around, power_of

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
#: Variance of a mean over powers of lines under Hann's window, over that of independent lines.
ALIKE = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)
#: A line this many times above its surroundings is a tone.
TONE = 25.0
#: The most tones that are looked for.
TONES = 16


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Noise at the lines of a residual's real transform; one is white noise of unit variance.

    Attributes:
        psd: noise at each bin, shape (samples // 2 + 1,).
        input_noise: σx² if it is significant, in squares of the residual's unit per |H|²; else zero.
        input_noise_at: the same at each line, with its colour: its share of the level there, shape (samples // 2 + 1,).
        doubt: makes σx² that may be left beside it (95 %) at each line, shape (samples // 2 + 1,).
        excited: weight of each line, shape (samples // 2 + 1,): zero where noise of the reference alone could explain
            the prediction.
        tones: places of tones in the residual (mains hum), in lines and fractions of one.
        free: whether the motion leaves lines free, in which noise of the reference would show.
    """

    psd: FloatArray
    input_noise: float
    input_noise_at: FloatArray
    doubt: Callable[[], FloatArray]
    excited: FloatArray
    tones: tuple[float, ...] = ()
    free: bool = False


def noise_spectrum(lines: ComplexArray, motion: Motion, floor: float) -> NoiseSpectrum:
    """Read the spectrum of a residual; see :func:`noise_spectra`."""
    return noise_spectra([lines], [motion], [floor])[0]


def noise_spectra(
    lines: Sequence[ComplexArray], motions: Sequence[Motion], floors: Sequence[float]
) -> list[NoiseSpectrum]:
    """Read the spectra of residuals.

    Args:
        lines: the residuals' real transforms, each of shape (samples // 2 + 1,).
        motions: what the model says of the same records.
        floors: lower limits of the residuals' levels.
    """
    noises = [incoherent(rest, motion) for rest, motion in zip(lines, motions, strict=True)]
    powers = [power_of(rest) for rest in noises]
    for power, motion in zip(powers, motions, strict=True):
        power /= motion.count
    levels = _binned_levels(powers, motions)
    found = []
    for rest, motion, floor, level in zip(lines, motions, floors, levels, strict=True):
        # of a long record each copy counts
        found.append(_read(rest, noises.pop(0), powers.pop(0), motion, floor, level))
    return found


def _read(
    lines: ComplexArray, noise: ComplexArray, power: FloatArray, motion: Motion, floor: float, binned: _Levels | None
) -> NoiseSpectrum:
    """The spectrum of a residual, of its incoherent part, the power of that at each line, and the levels in bins."""
    parts = _parts(noise, power, motion, binned)
    shape = parts.shape
    relative = np.divide(power, shape, out=power)
    smooth = _surroundings(relative)
    hum = (relative > OUTSTANDING * smooth) & ~motion.alone
    tones = _tones(lines, noise, lambda part: TONE * shape[part] * smooth[part] * motion.count, motion.alone)
    level = np.multiply(shape, smooth, where=~hum, out=np.multiply(shape, relative, out=relative))
    np.maximum(level, floor, out=level)
    excited = np.broadcast_to(1.0, level.shape)
    if motion.through is not None:  # by how much the prediction stands above what noise of the reference would be
        excited = np.maximum(motion.own, 1e-300)
        np.divide(level, excited, out=excited)
        excited *= -FAINT
        excited += 1.0
        np.maximum(excited, 0.0, out=excited)
    input_noise_at = np.broadcast_to(0.0, level.shape)
    if parts.input_noise > 0.0:
        input_noise_at = parts.unfelt * smooth
        input_noise_at *= motion.colour
    colour, doubt = motion.colour, parts.doubt  # of a long record each copy counts, also one that a closure keeps
    return NoiseSpectrum(level, parts.input_noise, input_noise_at, lambda: doubt() * colour, excited, tones, parts.free)


class _Parts(NamedTuple):
    """White and 1/f noise of the response, and that of the reference.

    Attributes:
        shape: their sum at each line, shape (lines,).
        input_noise: σx² if it is significant; else zero.
        unfelt: the same at each line, a number or shape (lines,).
        doubt: makes σx² that may be left beside it (95 %) at each line, shape (lines,).
        free: whether enough lines hold no motion.
    """

    shape: FloatArray
    input_noise: float
    unfelt: FloatArray | float
    doubt: Callable[[], FloatArray]
    free: bool


class _Levels(NamedTuple):
    """White and 1/f noise of the response, and that of the reference behind the sensor, in bins.

    Attributes:
        level: of the residual, shape (bins,).
        shapes: of the three, shape (3, bins).
        amounts: of these, shape (3,).
        spread: standard deviation of the last.
    """

    level: FloatArray
    shapes: FloatArray
    amounts: FloatArray
    spread: float


def _binned_levels(powers: Sequence[FloatArray], motions: Sequence[Motion]) -> list[_Levels | None]:
    """Of each residual; records whose bins see the same of the reference are fitted side by side."""
    found: list[_Levels | None] = [None] * len(powers)
    alike: dict[tuple[int, int, bytes], list[int]] = {}
    for number, (power, motion) in enumerate(zip(powers, motions, strict=True)):
        if motion.through is not None:
            alike.setdefault((len(power), motion.last, motion.seen.tobytes()), []).append(number)
    for (lines, last, _), numbers in alike.items():
        edges, wide, order, geometric = bins_of(lines, last)
        level, seen = np.stack([means(powers[i], edges) for i in numbers]) * geometric, motions[numbers[0]].seen
        shapes = np.stack([np.ones_like(order), order[0] / order, np.maximum(seen / np.max(seen), LEAST_LEVEL)])
        for number, own, amounts, spread in zip(numbers, level, *_levels(shapes, level, wide), strict=True):
            found[number] = _Levels(own, shapes, amounts, float(spread))
    return found


def _parts(lines: ComplexArray, power: FloatArray, motion: Motion, binned: _Levels | None) -> _Parts:
    through = motion.through
    if through is None or binned is None:
        return _Parts(np.ones_like(power), 0.0, 0.0, functools.partial(np.broadcast_to, 0.0, power.shape), False)
    edges, wide, order, _ = bins_of(len(power), motion.last)
    level, shapes, amounts, spread = binned
    seen, scale = motion.seen, float(np.max(motion.seen))
    variance, spread = amounts[2] / scale, spread / scale
    sure = variance > SIGNIFICANT * spread
    # All of the level at most; a bin of a few lines is low by chance.
    whole = (level / seen * (1.0 + DOUBT / np.sqrt(wide)))[wide >= min(MANY, np.max(wide))]
    most = min(DOUBT * spread if sure else variance + DOUBT * spread, float(np.min(whole)))
    input_noise = unfelt = variance if sure else 0.0
    doubt: Callable[[], FloatArray] = functools.partial(np.broadcast_to, most, power.shape)
    told = _unfelt(lines, motion, through, int(edges[-1]))
    by_reference = amounts[2] / scale * through
    if told.input_noise > 0.0:
        input_noise, doubt, unfelt, by_reference = told.input_noise, told.doubt, told.at_lines, told.at_lines * through
        amounts = _beside(shapes[:2], level, wide, means(by_reference, edges))
    elif not sure and told.spread < spread:
        doubt = told.doubt
    shape = np.arange(len(power), dtype=float)
    shape[0] = 1.0
    np.divide(amounts[1] * order[0], shape, out=shape)
    shape += amounts[0]
    shape += by_reference
    np.maximum(shape, LEAST_LEVEL * float(np.average(level, weights=wide)), out=shape)
    return _Parts(shape, input_noise, unfelt, doubt, told.free)


def _ordinary(relative: FloatArray, around: int) -> FloatArray:
    """The lines, those that stand out replaced by the mean around them."""
    most = OUTSTANDING * np.exp(np.mean(np.log(relative + 1e-300)) + np.euler_gamma)
    smooth = mean_around(np.minimum(relative, most), around, NEAREST)
    np.copyto(smooth, relative, where=relative < FAR * smooth)  # in place: of a long record each copy counts
    return smooth


def _surroundings(relative: FloatArray) -> FloatArray:
    """Mean over the lines around each, without those that stand out."""
    around = lines_around(relative)
    return mean_around(_ordinary(relative, around), around, NEAREST) / (1.0 - FAR * np.exp(-FAR))


@dataclass(frozen=True, eq=False)
class _Unfelt:
    """Noise of the reference, estimated mainly from lines without motion.

    Attributes:
        variance: mean of σx² over the lines.
        spread: its standard deviation.
        input_noise: the variance if it is significant; else zero.
        doubt: makes σx² that may be left beside it (95 %) at each line, shape (lines,).
        at_lines: σx² at each line, shape (lines,).
        free: whether enough lines hold no motion.
    """

    variance: float
    spread: float
    input_noise: float
    doubt: Callable[[], FloatArray]
    at_lines: FloatArray
    free: bool


def _unfelt(rest: ComplexArray, motion: Motion, through: FloatArray, last: int) -> _Unfelt:
    """Noise of the reference by what residual and prediction have in common.

    Noise n of the reference appears in the prediction as H n and in the residual as −H n, so −Re Ŷ* R has the mean
    |H|² σx². Lines without excitation determine it best, and each line is weighted by its scatter with motion. An
    error of the model gives a share of |Ŷ|², with a slope in f², where that is motion: where n may be all of it, it
    looks like |H|² σx². White and 1/f noise are separated.
    """
    share, (own, ordinary), found = through[1:last], motion.level(), np.zeros(4)
    common, left = np.empty(last - 1), np.empty(last - 1)
    for part in in_blocks(last - 1):  # of a long record each copy counts
        kept, moved = windowed(rest[part.start : part.stop + 2]), motion.windowed(part)
        common[part] = -(moved.real * kept.real + moved.imag * kept.imag) / motion.count
        left[part] = power_of(kept) / motion.count
    left = typical(left, lines_around(through))

    def columns(part: slice) -> FloatArray:
        order, loud = np.arange(part.start + 1, part.stop + 1) / last, own[part] * (own[part] >= QUIET * left[part])
        return np.stack([share[part], share[part] / (last * order), loud, loud * order**2])

    blocks = in_blocks(last - 1)
    kept = [columns(part) for part in blocks[:1]]
    for _ in range(2):
        gram, right = np.zeros((4, 4)), np.zeros(4)
        for part in blocks:
            rows = kept[0] if part.start == 0 else columns(part)
            weight = (found[:2] @ rows[:2]) ** 2
            weight += own[part] * left[part]
            weight = ordinary[part] / np.maximum(weight, 1e-300)
            weight *= 2.0 / ALIKE
            weighted = rows * weight
            gram += weighted @ rows.T
            right += weighted @ common[part]
        found, covariance, normal = _amounts(gram, right)
    del common, kept
    bent = _flicker(last, last)[1:]
    noise, mean = share * (found[0] + found[1] * bent), np.array([1.0, float(np.mean(bent))])
    del bent
    total, spread = float(mean @ found[:2]), float(np.sqrt(mean @ covariance[:2, :2] @ mean))
    free = bool(np.sum(own < QUIET * left) >= FEWEST_QUIET)
    if np.sum(own < QUIET * np.maximum(noise, left)) < FEWEST_QUIET:
        spread = np.inf  # motion everywhere: an error of the model cannot be separated from noise
    sure = total > SIGNIFICANT * spread
    flicker = functools.partial(_flicker, len(through), last)
    # Flicker noise may be present even if it is not significant.
    doubt = functools.partial(_doubt, flicker, normal, np.zeros(2) if sure else found)
    if sure:
        return _Unfelt(total, spread, total, doubt, found[0] + found[1] * flicker(), free)
    return _Unfelt(total, spread, 0.0, doubt, np.zeros(0), free)


def _flicker(lines: int, last: int) -> FloatArray:
    """1/f at each line, one at the first of ``last`` lines."""
    return (1.0 / last) / (np.maximum(np.arange(lines), 1.0) / last)


def _doubt(flicker: Callable[[], FloatArray], normal: FloatArray, found: FloatArray) -> FloatArray:
    """What was found of white and 1/f noise, and its uncertainty, at each line."""
    shape, whole = flicker(), inverse_normal(normal)
    around_it = whole[0, 0] + 2.0 * whole[0, 1] * shape + whole[1, 1] * shape**2
    return (found[0] + found[1] * shape) + DOUBT * np.sqrt(np.maximum(around_it, 0.0))


def _amounts(normal: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Least squares by its normal equations: the amounts, their covariance, and the normal matrix of all columns.

    The first two amounts are not negative; the second is left out if it is not significant.
    """
    scale = np.sqrt(np.where(np.diag(normal) > 0.0, np.diag(normal), 1.0))
    size = scale[:, None] * scale
    normal, right = normal / size, right / scale
    covariance = inverse_normal(normal)
    amounts = covariance @ right
    if not (amounts[0] >= 0.0 and amounts[1] > SIGNIFICANT * np.sqrt(covariance[1, 1])):
        kept = np.array([0, *range(2, len(right))])
        inverse = inverse_normal(normal[kept][:, kept])
        amounts, covariance = np.zeros_like(right), np.zeros_like(normal)
        amounts[kept], covariance[kept[:, None], kept] = inverse @ right[kept], inverse
    amounts[:2] = np.maximum(amounts[:2], 0.0)
    return amounts / scale, covariance / size, normal * size


def _tones(
    lines: ComplexArray, noise: ComplexArray, least: Callable[[slice], FloatArray], alone: BoolArray
) -> tuple[float, ...]:
    """Places of lines so strong that their leakage hides others, the strongest first, told from the whole residual."""
    power, apart = np.zeros(lines.size), np.zeros(lines.size)
    for part in in_blocks(lines.size - 2):
        for found, source in ((power, lines), (apart, noise)):
            found[part.start + 1 : part.stop + 1] = power_of(windowed(source[part.start : part.stop + 2]))
    peak = np.zeros(power.shape, dtype=bool)
    peak[2:-2] = (power[2:-2] >= power[1:-3]) & (power[2:-2] > power[3:-1])
    peak &= ~alone
    for part in in_blocks(power.size):
        peak[part] &= np.minimum(power[part], apart[part]) > least(part)
    places = np.flatnonzero(peak)
    places = places[np.argsort(-power[places])][:TONES]
    low, middle, high = (np.sqrt(power[places + shift]) for shift in (-1, 0, 1))
    beside = np.maximum(low, high) / middle
    # Between two lines, as Hann's window has it: a parabola would be off by up to two hundredths of a line.
    offset = np.clip((2.0 * beside - 1.0) / (1.0 + beside), 0.0, 0.5)
    return tuple((places + np.where(high > low, offset, -offset)).tolist())


def _levels(shapes: FloatArray, level: FloatArray, count: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Amounts of three shapes in R series, shape (R, 3), and the standard deviation of the last, by likelihood.

    Means of exponentially distributed lines; multiplicative updates keep the three levels positive (Févotte, Bertin &
    Durrieu 2009); the deviation is from Fisher's information.

    Args:
        shapes: shape (3, bins).
        level: shape (R, bins).
        count: lines of each bin, shape (bins,).
    """
    size = np.average(level, axis=1, weights=count)
    level = np.maximum(level / size[:, None], LEAST_LEVEL)
    runs, bins = level.shape
    amounts, across = np.full((runs, 3), 1.0 / 3.0), np.ascontiguousarray(shapes.T)
    fitted, both, sums = amounts @ shapes, np.empty((2 * runs, bins)), np.empty((2 * runs, 3))
    up, down = both[:runs], both[runs:]
    for _ in range(ROUNDS):
        np.divide(count, fitted, out=down)
        np.multiply(down, level, out=up)
        up /= fitted
        np.dot(both, across, out=sums)
        amounts *= sums[:runs]
        amounts /= sums[runs:]
        np.dot(amounts, shapes, out=fitted)
    information = (shapes * (count / fitted**2)[:, None]) @ shapes.T
    # 1/f noise at its bound is no unknown: it cannot hide the others. White noise of the response can.
    hidden = amounts[:, 1] <= 1e-6 * np.max(amounts, axis=1)
    spread = [
        np.sqrt(inverse_normal(own[::2, ::2] if bound else own)[-1, -1])
        for own, bound in zip(information, hidden, strict=True)
    ]
    return size[:, None] * amounts, size * np.array(spread)


def _beside(shapes: FloatArray, level: FloatArray, count: FloatArray, known: FloatArray) -> FloatArray:
    """Amounts of shapes beside what is known, by likelihood; as :func:`_levels`."""
    amounts = np.full(len(shapes), 0.1 * float(np.average(level, weights=count)))
    for _ in range(ROUNDS):
        fitted = amounts @ shapes + known
        amounts = amounts * (shapes @ (count * level / fitted**2)) / (shapes @ (count / fitted))
    return amounts

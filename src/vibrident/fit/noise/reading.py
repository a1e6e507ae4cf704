"""The noise of records at the bins of their band, read from residuals of a model.

Noise of the response, white, 1/f and 1/f², and noise σx² of the reference, which passes the model:

    S(f) = a + c/f + d/f² + σx² g(f) |H(f)|²

by likelihood, with g one for white noise and ∝ f⁴ for an acceleration made of a displacement. What
other shape there is comes on top as the mean of the periodogram over the bins around, relative to
this. What is read is the part of the residual that is locally incoherent with the motion
(:mod:`vibrident.fit.noise.projection`): a wrong model does not make its own noise.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.group.group import in_parts
from vibrident.fit.noise.averages import (
    averaged_bins,
    level_around,
    log_bins,
    log_power,
    mean_around,
    mean_over_geometric,
)
from vibrident.fit.noise.common import SIGNIFICANT_DEVIATIONS, CommonNoise, common_noise
from vibrident.fit.noise.likelihood import MIN_LEVEL, amounts_of, variances_of_last
from vibrident.fit.noise.lines import OUTSTANDING_RATIO, lines_of_motion
from vibrident.fit.noise.projection import BLOCK_BINS, RIDGE, without_common
from vibrident.fit.noise.surroundings import MIN_FREEDOM, level_of_noise
from vibrident.fit.noise.tones import tones_of
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import MIN_SPECTRUM_SAMPLES, power_of

#: A bin holds motion where the measured response's power is so many times the noise.
HEARD_RATIO = 10.0
#: So many bins of a block that are heard only once a misfit is out are no chance.
MAX_NEWLY_HEARD = 6
#: Bins count where the prediction is more than so many times what noise of the reference would be.
FAINT_RATIO = 2.0
#: The uncertainty that is left of σx², in standard deviations.
DOUBT_DEVIATIONS = 2.0
#: Fewest bins for a level.
MIN_LEVEL_BINS = 16
#: Powers behind a level at least: of fewer, rounding is left.
MIN_COUNT = 0.05


@dataclass(frozen=True, eq=False)
class GroupNoise:
    """Noise of R records at K bins; one is white noise of unit variance.

    Attributes:
        psd: noise at each bin, shape (R, K).
        input_noise: σx² where it is significant, in squares of the residual's unit per |H|², else
            zero, shape (R,).
        input_noise_at: the same at each bin, with its colour: its share of the level there divided
            by |H|², shape (R, K).
        doubts: a, c, and the variances of a and c and their covariance, of what may be left of σx²
            = a + c/k at bin k, shape (R, 5).
        colour: power of the reference's noise over its mean, one or shape (K,).
        excited: weight of each bin, shape (R, K): zero where noise of the reference alone could
            explain the prediction.
        tones: places of tones in the residual (hum of the mains), in bins, of each record.
        free: whether motion leaves bins free, in which noise of the reference shows, shape (R,).
    """

    psd: FloatArray
    input_noise: FloatArray
    input_noise_at: FloatArray
    doubts: FloatArray
    colour: FloatArray | float
    excited: FloatArray
    tones: tuple[tuple[float, ...], ...]
    free: BoolArray

    @property
    def doubt(self) -> FloatArray:
        """Return σx² that may be left beside ``input_noise`` (95 %) at each bin, shape (R, K)."""
        flicker = _flicker(self.psd.shape[1])
        white, pink, of_white, of_pink, of_both = self.doubts.T[:, :, None]
        variance = of_white + 2.0 * of_both * flicker + of_pink * flicker**2
        level = white + pink * flicker
        level += DOUBT_DEVIATIONS * np.sqrt(np.maximum(variance, 0.0))
        return level * self.colour


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of R records of one length and rate, and what is known beside them.

    Attributes:
        residual: measured less predicted response, shape (R, K); bin 0 does not count.
        predicted: the model's response, shape (R, K).
        count: samples used, shape (R,).
        floor: lower limits of the levels, shape (R,).
        through: g |H|², shape (1, K) where it is one of all, or (R, K); None without a reference.
        reference: shape (R, K); None where the prediction alone says what is motion.
        passed: H times the reference, bin by bin, shape (R, K); None: that is the prediction. With
            initial states in it, what leaks into both would cancel, and leave the noise.
        heard: bins at which motion shows in the response without any model, shape (R, K): there
            alone what is coherent with the motion is no noise. None: where the response is loud.
        lines: bins whose remainder is the motion's, too, and no hum, shape (R, K); None: no others.
        fitted: count of numbers that were fitted to each record, shape (R,); None: none.
    """

    residual: ComplexArray
    predicted: ComplexArray
    count: FloatArray
    floor: FloatArray
    through: FloatArray | None = None
    reference: ComplexArray | None = None
    passed: ComplexArray | None = None
    heard: BoolArray | None = None
    lines: BoolArray | None = None
    fitted: FloatArray | None = None

    def some(self, part: slice) -> Residuals:
        """Return some of the records."""
        rows = {field.name: getattr(self, field.name) for field in fields(self)}
        shared = {"through"} if self.through is not None and len(self.through) == 1 else set()
        return replace(
            self,
            **{
                name: array[part]
                for name, array in rows.items()
                if array is not None and name not in shared
            },
        )


class _InputNoise(NamedTuple):
    """Noise of the reference; for ``doubts`` and ``free`` see :class:`GroupNoise`.

    Attributes:
        variance: σx² where it is significant, else zero, shape (R,).
        amounts: a and c of it, a + c/k at bin k, shape (R, 2).
        doubts: shape (R, 5).
        free: shape (R,).
    """

    variance: FloatArray
    amounts: FloatArray
    doubts: FloatArray
    free: BoolArray


class _Read(NamedTuple):
    """What of a residual is locally incoherent with the motion.

    Attributes:
        noise: that part, shape (R, K).
        power: of it, shape (R, K).
        freedom: degrees of freedom behind each power, 0 … 1, shape (R, K).
    """

    noise: ComplexArray
    power: FloatArray
    freedom: FloatArray


def read_noise(rows: Residuals, last: int, colour: FloatArray | float = 1.0) -> GroupNoise:
    """Read the noise of records of one length and rate.

    Args:
        rows: their residuals.
        last: bins from here on are not looked at.
        colour: g, power of the reference's noise over its mean, one or shape (K,).
    """
    records, bins = rows.residual.shape
    last = max(min(last, bins - 1), 1)
    read = (
        _read_one_level
        if last <= BLOCK_BINS or np.max(rows.count) < MIN_SPECTRUM_SAMPLES
        else _read
    )
    parts = [read(rows.some(part), last, colour) for part in in_parts(records, bins)]
    if len(parts) == 1:
        return parts[0]
    names = "psd", "input_noise", "input_noise_at", "doubts", "excited", "free"
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    tones = tuple(places for part in parts for places in part.tones)
    return GroupNoise(colour=colour, tones=tones, **arrays)


def _read_one_level(rows: Residuals, last: int, colour: FloatArray | float) -> GroupNoise:
    """Read one level of each record, as of few bins no more can be read."""
    shape = rows.residual.shape
    squares = np.sum(power_of(rows.residual[:, 1 : last + 1]), axis=1, keepdims=True)
    fitted = 0.0 if rows.fitted is None else rows.fitted[:, None]
    unfitted = np.maximum(last - 0.5 * fitted, 0.5)  # half a bin, a number, at least
    level = squares / (unfitted * rows.count[:, None])
    psd = np.broadcast_to(np.maximum(level, rows.floor[:, None]), shape)
    none = _no_input_noise(len(psd))
    if rows.through is not None:
        none.doubts[:, :1] = psd[:, :1] / np.max(rows.through, axis=1, keepdims=True)
    nothing = np.zeros(shape)
    tones = ((),) * len(psd)
    return GroupNoise(
        psd, none.variance, nothing, none.doubts, colour, nothing + 1.0, tones, none.free
    )


def _read(rows: Residuals, last: int, colour: FloatArray | float) -> GroupNoise:
    """Read the noise of records."""
    count = rows.count[:, None]
    expected = power_of(rows.predicted)
    log_expected = log_power(expected)
    log_through = None if rows.through is None else log_power(rows.through)
    width = averaged_bins(expected.shape[1])
    moved = lines_of_motion(expected, log_expected, log_through, width)
    if rows.lines is not None:
        moved |= rows.lines
    read = _incoherent(rows, log_through)
    np.divide(read.power, count, out=read.power)
    shape, of_input = _shape(rows, read, log_through, last)
    relative = np.divide(read.power, shape, out=read.power)
    smooth = level_of_noise(relative, read.freedom)
    hum = relative > OUTSTANDING_RATIO * smooth
    hum &= ~moved
    psd = shape * smooth
    tones = tones_of(rows.residual, read.noise, psd * count, moved)
    np.multiply(shape, relative, out=psd, where=hum)
    np.maximum(psd, rows.floor[:, None], out=psd)
    excited = np.ones(psd.shape)
    if rows.through is not None:
        # By how much the prediction stands above what noise of the reference would be.
        level = np.exp(mean_around(log_expected, width) + np.euler_gamma)
        np.copyto(level, expected, where=expected > OUTSTANDING_RATIO * level)
        level /= count
        excited -= FAINT_RATIO * psd / np.maximum(level, 1e-300)
        np.maximum(excited, 0.0, out=excited)
    white, pink = of_input.amounts.T[:, :, None]
    smooth *= white + pink * _flicker(psd.shape[1])
    smooth *= colour
    return GroupNoise(
        psd, of_input.variance, smooth, of_input.doubts, colour, excited, tones, of_input.free
    )


def _incoherent(rows: Residuals, log_through: FloatArray | None) -> _Read:
    """Return what of the residual is locally incoherent with the motion, where that is heard.

    The level by which it is heard is that of the noise, as of the response or as of the reference
    behind the sensor, whichever is more: beside a resonance noise of the reference falls steeply,
    and what it is there stands far above a mean over the bins around. That level also whitens the
    noise of each block, which is steep in the lowest. Of a residual that is mostly misfit it is too
    high at first, so records in which more is heard once the misfit is out are read again.
    """
    if rows.reference is None:
        motions = [rows.predicted]
        measured = power_of(rows.predicted)
    else:
        motions = [rows.reference, rows.predicted if rows.passed is None else rows.passed]
        measured = power_of(rows.predicted + rows.residual)
    measured[:, 0] = 0.0
    steep: FloatArray | float = 0.0
    if log_through is not None:
        steep = np.maximum(log_through - level_around(log_through), 0.0)

    def threshold(power: FloatArray) -> FloatArray:
        level = level_around(log_power(power))
        level += steep
        level += np.euler_gamma
        return np.exp(level, out=level)

    def projected(some: slice | NDArray[np.int_], heard: BoolArray, level: FloatArray) -> _Read:
        left, freedom = without_common(
            rows.residual[some], [motion[some] for motion in motions], np.sqrt(level), heard
        )
        return _Read(left, power_of(left), freedom)

    level = threshold(power_of(rows.residual))
    if rows.heard is not None:
        return projected(slice(None), rows.heard, level)
    heard = measured > HEARD_RATIO * level
    read = projected(slice(None), heard, level)
    # Where no freedom is left, nothing is but rounding: less than the ridge.
    power = np.maximum(read.power, RIDGE * power_of(rows.residual))
    level = threshold(power / np.maximum(read.freedom, MIN_FREEDOM))
    clearer = measured > HEARD_RATIO * level
    newly = np.add.reduceat(clearer & ~heard, np.arange(1, level.shape[1], BLOCK_BINS), axis=1)
    again = np.flatnonzero(np.any(newly >= MAX_NEWLY_HEARD, axis=1))
    if again.size:
        again_read = projected(again, clearer[again], level[again])
        for array, part in zip(read, again_read, strict=True):
            array[again] = part
    return read


def _shape(
    rows: Residuals, read: _Read, log_through: FloatArray | None, last: int
) -> tuple[FloatArray, _InputNoise]:
    """Return the noise of known shapes, shape (R, K), and that of the reference."""
    power, freedom = read.power, read.freedom
    records, bins = power.shape
    grid = log_bins(last)
    counts = grid.sums(freedom)
    logarithm = freedom * log_power(power / np.maximum(freedom, MIN_FREEDOM))
    level = np.exp(grid.sums(logarithm) / np.maximum(counts, MIN_FREEDOM))
    level *= mean_over_geometric(counts)
    told = counts >= MIN_COUNT
    counts = np.where(told, counts, 0.0)
    level = np.where(told, level, 0.0)
    own = grid.order ** np.array([[0.0], [-1.0], [-2.0]])
    if rows.through is None or log_through is None:
        amounts = amounts_of(own[None], level[None], counts[None]).values[0]
        return _by_amounts(amounts, bins), _no_input_noise(records)
    seen = grid.geometric_means(log_through)
    scale = np.max(seen, axis=-1, keepdims=True)
    of_input = np.maximum(seen / scale, MIN_LEVEL)[:, None]
    shapes = np.concatenate([np.broadcast_to(own, (len(seen), *own.shape)), of_input], axis=1)
    # Records that see the same of the reference are one group of many spectra.
    groups = (1, records) if len(seen) == 1 else (records, 1)
    fitted = amounts_of(shapes, level.reshape(*groups, -1), counts.reshape(*groups, -1))
    amounts = fitted.values.reshape(records, -1)
    variance = amounts[:, -1] / scale[:, 0]
    spread = np.sqrt(variances_of_last(fitted, slice(1, 3))).reshape(-1) / scale[:, 0]
    # All of the level at most; a bin of few bins is low by chance.
    most = level / seen * (1.0 + DOUBT_DEVIATIONS / np.sqrt(np.maximum(counts, MIN_FREEDOM)))
    enough = counts >= np.minimum(MIN_LEVEL_BINS, np.max(counts, axis=1, keepdims=True))
    most = np.min(np.where(enough, most, np.inf), axis=1)
    common = common_noise(read.noise, rows.predicted, rows.through, rows.count[:, None], last)
    noise = _chosen(common, variance, spread, most)
    better = common.significant
    white = np.where(better, common.amounts[:, 0], variance)
    pink = np.where(better, common.amounts[:, 1], 0.0)
    by_reference = white[:, None] + pink[:, None] * _flicker(bins)
    by_reference *= rows.through
    if np.any(better):
        known = grid.geometric_means(log_power(by_reference[better]))
        beside = amounts_of(own[None], level[None, better], counts[None, better], known[None])
        amounts[better, :3] = beside.values[0]
    return _by_amounts(amounts, bins, by_reference), noise


def _chosen(
    common: CommonNoise, variance: FloatArray, spread: FloatArray, most: FloatArray
) -> _InputNoise:
    """Choose between two estimates of noise of the reference, each of shape (R,).

    Args:
        common: by what residual and prediction have in common.
        variance: by the shape of the noise alone.
        spread: standard deviation of that.
        most: all of the noise at most.
    """
    better = common.significant
    # Coloured noise of the response may look like that of the reference, but has nothing in common
    # with the prediction. Coloured noise of the reference may have none either where nothing moves:
    # so it is none for sure, but in doubt.
    refuted = variance > common.variance + SIGNIFICANT_DEVIATIONS * common.spread
    sure = (variance > SIGNIFICANT_DEVIATIONS * spread) & ~refuted
    amounts = np.where(better[:, None], common.amounts, 0.0)
    amounts[:, 0] = np.where(sure & ~better, variance, amounts[:, 0])
    doubts = np.zeros((len(most), 5))
    doubts[:, 0] = np.minimum(most, np.where(sure, 0.0, variance) + DOUBT_DEVIATIONS * spread)
    # 1/f noise may be present even if it is not significant.
    remaining = np.where(better[:, None], 0.0, common.amounts)
    variances = np.diagonal(common.covariance, axis1=1, axis2=2)
    others = np.column_stack([remaining, variances, common.covariance[:, 0, 1]])
    by_common = better | (~sure & ~refuted & (common.spread < spread))
    doubts = np.where(by_common[:, None], others, doubts)
    return _InputNoise(
        np.where(better, common.variance, amounts[:, 0]), amounts, doubts, common.free
    )


def _no_input_noise(records: int) -> _InputNoise:
    """Return none, of so many records."""
    free = np.zeros(records, dtype=bool)
    return _InputNoise(np.zeros(records), np.zeros((records, 2)), np.zeros((records, 5)), free)


def _by_amounts(
    amounts: FloatArray, bins: int, by_reference: FloatArray | float = 0.0
) -> FloatArray:
    """Return a + c/k + d/k² and what the reference makes, shape (R, K)."""
    flicker = _flicker(bins)
    shape = amounts[:, 2:3] * flicker
    shape += amounts[:, 1:2]
    shape *= flicker
    shape += amounts[:, :1]
    shape += by_reference
    return np.maximum(shape, MIN_LEVEL * np.mean(shape, axis=1, keepdims=True), out=shape)


def _flicker(bins: int) -> FloatArray:
    """Return 1/k at each bin k; at bin 0, which does not count, as at bin 1."""
    return 1.0 / np.maximum(np.arange(bins), 1.0)

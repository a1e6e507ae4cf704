"""Noise of records at the bins of their band, estimated from residuals of a model.

Noise of the response, white, 1/f and 1/f², and noise σx² of the reference, which passes the model:

    S(f) = a + c/f + d/f² + σx² g(f) |H(f)|²

by likelihood, with g one for white noise and ∝ f⁴ for an acceleration derived from a displacement.
Any other shape is added as the mean of the periodogram over the bins around, relative to this. The
estimate uses the component of the residual that is locally incoherent with the motion
(:mod:`vibrident.fit.noise.projection`): a wrong model does not produce noise.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.group.group import in_batches
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

#: A bin holds motion where the power of the measured response is so many times the noise.
HEARD_RATIO = 10.0
#: So many bins of a block that are heard only once a misfit is removed are no chance.
MAX_NEWLY_HEARD = 6
#: Bins count where the prediction exceeds so many times that due to noise of the reference.
FAINT_RATIO = 2.0
#: Uncertainty that remains of σx², in standard deviations.
DOUBT_DEVIATIONS = 2.0
#: Fewest bins for a level.
MIN_LEVEL_BINS = 16
#: Fewest powers behind a level: fewer are rounding.
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
        doubts: a, c, and the variances of a and c and their covariance, of the remaining σx² = a +
            c/k at bin k, shape (R, 5).
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
        """Return σx² that may remain beyond ``input_noise`` (95 %) at each bin, shape (R, K)."""
        flicker = _flicker(self.psd.shape[1])
        white, pink, white_variance, pink_variance, covariance = self.doubts.T[:, :, None]
        variance = white_variance + 2.0 * covariance * flicker + pink_variance * flicker**2
        level = white + pink * flicker
        level += DOUBT_DEVIATIONS * np.sqrt(np.maximum(variance, 0.0))
        return level * self.colour


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of R records of one length and rate, with what is known about them.

    Attributes:
        residual: measured less predicted response, shape (R, K); bin 0 does not count.
        predicted: the model's response, shape (R, K).
        count: samples used, shape (R,).
        floor: lower limits of the levels, shape (R,).
        through: g |H|², shape (1, K) where it is one of all, or (R, K); None without a reference.
        reference: shape (R, K); None where the prediction alone represents the motion.
        passed: H times the reference, bin by bin, shape (R, K); None takes the prediction. With
            initial states in it, leakage into both would cancel, and leave the noise.
        heard: bins at which motion shows in the response without any model, shape (R, K): there
            alone what is coherent with the motion is no noise. None: where the response is loud.
        lines: further bins whose remainder is the motion's, and no hum, shape (R, K); None: no
            others.
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

    def records(self, rows: slice) -> Residuals:
        """Return the residuals of some of the records."""
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        shared = {"through"} if self.through is not None and len(self.through) == 1 else set()
        return replace(
            self,
            **{
                name: array[rows]
                for name, array in arrays.items()
                if array is not None and name not in shared
            },
        )


class _InputNoise(NamedTuple):
    """Noise of the reference; for ``doubts`` and ``free`` see :class:`GroupNoise`.

    Attributes:
        variance: σx² where it is significant, else zero, shape (R,).
        amounts: its a and c, a + c/k at bin k, shape (R, 2).
        doubts: shape (R, 5).
        free: shape (R,).
    """

    variance: FloatArray
    amounts: FloatArray
    doubts: FloatArray
    free: BoolArray


class _Incoherent(NamedTuple):
    """Component of a residual that is locally incoherent with the motion.

    Attributes:
        noise: the component, shape (R, K).
        power: of it, shape (R, K).
        freedom: degrees of freedom behind each power, 0 … 1, shape (R, K).
    """

    noise: ComplexArray
    power: FloatArray
    freedom: FloatArray


def read_noise(rows: Residuals, last: int, colour: FloatArray | float = 1.0) -> GroupNoise:
    """Return the noise of records of one length and rate.

    Args:
        rows: their residuals.
        last: bins from here on do not count.
        colour: g, power of the reference's noise over its mean, one or shape (K,).
    """
    records, bins = rows.residual.shape
    last = max(min(last, bins - 1), 1)
    few_bins = last <= BLOCK_BINS or np.max(rows.count) < MIN_SPECTRUM_SAMPLES
    read = _read_one_level if few_bins else _read
    batches = [read(rows.records(batch), last, colour) for batch in in_batches(records, bins)]
    if len(batches) == 1:
        return batches[0]
    names = "psd", "input_noise", "input_noise_at", "doubts", "excited", "free"
    arrays = {name: np.concatenate([getattr(noise, name) for noise in batches]) for name in names}
    tones = tuple(places for noise in batches for places in noise.tones)
    return GroupNoise(colour=colour, tones=tones, **arrays)


def _read_one_level(rows: Residuals, last: int, colour: FloatArray | float) -> GroupNoise:
    """Return one level for each record, all that few bins can determine."""
    shape = rows.residual.shape
    squares = np.sum(power_of(rows.residual[:, 1 : last + 1]), axis=1, keepdims=True)
    fitted = 0.0 if rows.fitted is None else rows.fitted[:, None]
    unfitted = np.maximum(last - 0.5 * fitted, 0.5)  # half a bin for each number
    level = squares / (unfitted * rows.count[:, None])
    psd = np.broadcast_to(np.maximum(level, rows.floor[:, None]), shape)
    no_input_noise = _no_input_noise(len(psd))
    if rows.through is not None:
        no_input_noise.doubts[:, :1] = psd[:, :1] / np.max(rows.through, axis=1, keepdims=True)
    zeros = np.zeros(shape)
    tones = ((),) * len(psd)
    return GroupNoise(
        psd,
        no_input_noise.variance,
        zeros,
        no_input_noise.doubts,
        colour,
        zeros + 1.0,
        tones,
        no_input_noise.free,
    )


def _read(rows: Residuals, last: int, colour: FloatArray | float) -> GroupNoise:
    """Return the noise of records."""
    count = rows.count[:, None]
    expected = power_of(rows.predicted)
    log_expected = log_power(expected)
    log_through = None if rows.through is None else log_power(rows.through)
    width = averaged_bins(expected.shape[1])
    lines = lines_of_motion(expected, log_expected, log_through, width)
    if rows.lines is not None:
        lines |= rows.lines
    incoherent = _incoherent(rows, log_through)
    np.divide(incoherent.power, count, out=incoherent.power)
    shape, input_noise = _shape(rows, incoherent, log_through, last)
    relative = np.divide(incoherent.power, shape, out=incoherent.power)
    smooth = level_of_noise(relative, incoherent.freedom)
    hum = relative > OUTSTANDING_RATIO * smooth
    hum &= ~lines
    psd = shape * smooth
    tones = tones_of(rows.residual, incoherent.noise, psd * count, lines)
    np.multiply(shape, relative, out=psd, where=hum)
    np.maximum(psd, rows.floor[:, None], out=psd)
    excited = np.ones(psd.shape)
    if rows.through is not None:
        # Excess of the prediction over that due to noise of the reference.
        level = np.exp(mean_around(log_expected, width) + np.euler_gamma)
        np.copyto(level, expected, where=expected > OUTSTANDING_RATIO * level)
        level /= count
        excited -= FAINT_RATIO * psd / np.maximum(level, 1e-300)
        np.maximum(excited, 0.0, out=excited)
    white, pink = input_noise.amounts.T[:, :, None]
    smooth *= white + pink * _flicker(psd.shape[1])
    smooth *= colour
    return GroupNoise(
        psd,
        input_noise.variance,
        smooth,
        input_noise.doubts,
        colour,
        excited,
        tones,
        input_noise.free,
    )


def _incoherent(rows: Residuals, log_through: FloatArray | None) -> _Incoherent:
    """Return the component of the residual that is locally incoherent with the motion.

    The level by which motion is heard is that of the noise, as of the response or as of the
    reference behind the sensor, whichever is more: beside a resonance noise of the reference falls
    steeply, and its level there is far above a mean over the bins around. That level also whitens
    the noise of each block, which is steep in the lowest. Of a residual that is mostly misfit it is
    too high at first, so records in which more is heard once the misfit is removed are estimated
    again.
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

    def projected(
        records: slice | NDArray[np.int_], heard: BoolArray, level: FloatArray
    ) -> _Incoherent:
        noise, freedom = without_common(
            rows.residual[records], [motion[records] for motion in motions], np.sqrt(level), heard
        )
        return _Incoherent(noise, power_of(noise), freedom)

    level = threshold(power_of(rows.residual))
    if rows.heard is not None:
        return projected(slice(None), rows.heard, level)
    heard = measured > HEARD_RATIO * level
    incoherent = projected(slice(None), heard, level)
    # Where no freedom remains, only rounding does: less than the ridge.
    power = np.maximum(incoherent.power, RIDGE * power_of(rows.residual))
    level = threshold(power / np.maximum(incoherent.freedom, MIN_FREEDOM))
    heard_now = measured > HEARD_RATIO * level
    blocks = np.arange(1, level.shape[1], BLOCK_BINS)
    newly_heard = np.add.reduceat(heard_now & ~heard, blocks, axis=1)
    repeated = np.flatnonzero(np.any(newly_heard >= MAX_NEWLY_HEARD, axis=1))
    if repeated.size:
        second = projected(repeated, heard_now[repeated], level[repeated])
        for array, rows_again in zip(incoherent, second, strict=True):
            array[repeated] = rows_again
    return incoherent


def _shape(
    rows: Residuals, incoherent: _Incoherent, log_through: FloatArray | None, last: int
) -> tuple[FloatArray, _InputNoise]:
    """Return the noise of known shapes, shape (R, K), and that of the reference."""
    power = incoherent.power
    freedom = incoherent.freedom
    records, bins = power.shape
    grid = log_bins(last)
    counts = grid.sums(freedom)
    logarithm = freedom * log_power(power / np.maximum(freedom, MIN_FREEDOM))
    level = np.exp(grid.sums(logarithm) / np.maximum(counts, MIN_FREEDOM))
    level *= mean_over_geometric(counts)
    enough_powers = counts >= MIN_COUNT
    counts = np.where(enough_powers, counts, 0.0)
    level = np.where(enough_powers, level, 0.0)
    response_shapes = grid.order ** np.array([[0.0], [-1.0], [-2.0]])
    if rows.through is None or log_through is None:
        amounts = amounts_of(response_shapes[None], level[None], counts[None]).values[0]
        return _by_amounts(amounts, bins), _no_input_noise(records)
    reference_level = grid.geometric_means(log_through)
    scale = np.max(reference_level, axis=-1, keepdims=True)
    reference_shape = np.maximum(reference_level / scale, MIN_LEVEL)[:, None]
    shapes = np.concatenate(
        [
            np.broadcast_to(response_shapes, (len(reference_level), *response_shapes.shape)),
            reference_shape,
        ],
        axis=1,
    )
    # Records with the same gain are one group of many spectra.
    groups = (1, records) if len(reference_level) == 1 else (records, 1)
    fitted = amounts_of(shapes, level.reshape(*groups, -1), counts.reshape(*groups, -1))
    amounts = fitted.values.reshape(records, -1)
    variance = amounts[:, -1] / scale[:, 0]
    spread = np.sqrt(variances_of_last(fitted, slice(1, 3))).reshape(-1) / scale[:, 0]
    # At most all of the level; a level of few bins is low by chance.
    limit = (
        level
        / reference_level
        * (1.0 + DOUBT_DEVIATIONS / np.sqrt(np.maximum(counts, MIN_FREEDOM)))
    )
    enough = counts >= np.minimum(MIN_LEVEL_BINS, np.max(counts, axis=1, keepdims=True))
    limit = np.min(np.where(enough, limit, np.inf), axis=1)
    common = common_noise(incoherent.noise, rows.predicted, rows.through, rows.count[:, None], last)
    noise = _chosen(common, variance, spread, limit)
    by_common = common.significant
    white = np.where(by_common, common.amounts[:, 0], variance)
    pink = np.where(by_common, common.amounts[:, 1], 0.0)
    by_reference = white[:, None] + pink[:, None] * _flicker(bins)
    by_reference *= rows.through
    if np.any(by_common):
        known = grid.geometric_means(log_power(by_reference[by_common]))
        refitted = amounts_of(
            response_shapes[None], level[None, by_common], counts[None, by_common], known[None]
        )
        amounts[by_common, :3] = refitted.values[0]
    return _by_amounts(amounts, bins, by_reference), noise


def _chosen(
    common: CommonNoise, variance: FloatArray, spread: FloatArray, most: FloatArray
) -> _InputNoise:
    """Return the better of two estimates of noise of the reference, each of shape (R,).

    Args:
        common: from the correlation of residual and prediction.
        variance: from the shape of the noise alone.
        spread: standard deviation of that.
        most: upper limit, all of the noise.
    """
    by_correlation = common.significant
    # Coloured noise of the response may look like that of the reference, but is not correlated with
    # the prediction. Coloured noise of the reference may not be either where nothing moves: so it
    # is not certain, but in doubt.
    refuted = variance > common.variance + SIGNIFICANT_DEVIATIONS * common.spread
    certain = (variance > SIGNIFICANT_DEVIATIONS * spread) & ~refuted
    amounts = np.where(by_correlation[:, None], common.amounts, 0.0)
    amounts[:, 0] = np.where(certain & ~by_correlation, variance, amounts[:, 0])
    doubts = np.zeros((len(most), 5))
    doubts[:, 0] = np.minimum(most, np.where(certain, 0.0, variance) + DOUBT_DEVIATIONS * spread)
    # 1/f noise may be present even if it is not significant.
    remaining = np.where(by_correlation[:, None], 0.0, common.amounts)
    variances = np.diagonal(common.covariance, axis1=1, axis2=2)
    correlation_doubts = np.column_stack([remaining, variances, common.covariance[:, 0, 1]])
    doubt_by_correlation = by_correlation | (~certain & ~refuted & (common.spread < spread))
    doubts = np.where(doubt_by_correlation[:, None], correlation_doubts, doubts)
    return _InputNoise(
        np.where(by_correlation, common.variance, amounts[:, 0]), amounts, doubts, common.free
    )


def _no_input_noise(records: int) -> _InputNoise:
    """Return no noise of the reference, of so many records."""
    free = np.zeros(records, dtype=bool)
    return _InputNoise(np.zeros(records), np.zeros((records, 2)), np.zeros((records, 5)), free)


def _by_amounts(
    amounts: FloatArray, bins: int, by_reference: FloatArray | float = 0.0
) -> FloatArray:
    """Return a + c/k + d/k² and the noise from the reference, shape (R, K)."""
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

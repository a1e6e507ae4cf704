"""Noise of known shapes in the incoherent component of residuals: of the response and reference."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.likelihood import MIN_LEVEL, amounts_of, variances_of_last
from vibrident.fit.noise.averages import log_bins, log_power, mean_over_geometric
from vibrident.fit.noise.common import SIGNIFICANT_DEVIATIONS, CommonNoise, common_noise
from vibrident.fit.noise.incoherent import Incoherent
from vibrident.fit.noise.residuals import Residuals
from vibrident.fit.noise.surroundings import MIN_FREEDOM

#: Uncertainty that remains of σx², in standard deviations.
DOUBT_DEVIATIONS = 2.0
#: Fewest bins for a level.
MIN_LEVEL_BINS = 16
#: Fewest powers behind a level: fewer are rounding.
MIN_COUNT = 0.05


class InputNoise(NamedTuple):
    """Noise of the reference; for ``doubts`` and ``free`` see :class:`GroupNoise`.

    Attributes:
        variance: σx² where it is significant, else zero, shape (R,).
        amounts: its a, c and d, a + c/k + d/k² at bin k, shape (R, 3).
        doubts: shape (R, 5).
        free: shape (R,).
    """

    variance: FloatArray
    amounts: FloatArray
    doubts: FloatArray
    free: BoolArray


def noise_of_shapes(
    rows: Residuals, incoherent: Incoherent, log_through: FloatArray | None, last: int
) -> tuple[FloatArray, InputNoise]:
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
        return _at_bins(amounts, bins), no_input_noise(records)
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
    of_reference = np.where(by_common[:, None], common.amounts, 0.0)
    of_reference[~by_common, 0] = variance[~by_common]
    by_reference = by_amounts(of_reference, bins) * rows.through
    if np.any(by_common):
        known_level = grid.geometric_means(log_power(by_reference[by_common]))
        refitted = amounts_of(
            response_shapes[None],
            level[None, by_common],
            counts[None, by_common],
            known_level[None],
        )
        amounts[by_common, :3] = refitted.values[0]
    return _at_bins(amounts, bins, by_reference), noise


def _chosen(
    common: CommonNoise, variance: FloatArray, spread: FloatArray, limit: FloatArray
) -> InputNoise:
    """Return the better of two estimates of noise of the reference, each of shape (R,).

    Args:
        common: from the correlation of residual and prediction.
        variance: from the shape of the noise alone.
        spread: standard deviation of that.
        limit: all of the noise at most.
    """
    by_correlation = common.significant
    # Coloured noise of the response may look like that of the reference, but is not correlated with
    # the prediction. Coloured noise of the reference may not be either where nothing moves: so it
    # is not certain, but in doubt.
    refuted = variance > common.variance + SIGNIFICANT_DEVIATIONS * common.spread
    certain = (variance > SIGNIFICANT_DEVIATIONS * spread) & ~refuted
    amounts = np.where(by_correlation[:, None], common.amounts, 0.0)
    amounts[:, 0] = np.where(certain & ~by_correlation, variance, amounts[:, 0])
    doubts = np.zeros((len(limit), 5))
    doubts[:, 0] = np.minimum(limit, np.where(certain, 0.0, variance) + DOUBT_DEVIATIONS * spread)
    # 1/f noise may be present even if it is not significant.
    remaining = np.where(by_correlation[:, None], 0.0, common.amounts[:, :2])
    variances = np.diagonal(common.covariance, axis1=1, axis2=2)
    correlation_doubts = np.column_stack([remaining, variances, common.covariance[:, 0, 1]])
    doubt_by_correlation = by_correlation | (~certain & ~refuted & (common.spread < spread))
    doubts = np.where(doubt_by_correlation[:, None], correlation_doubts, doubts)
    return InputNoise(
        np.where(by_correlation, common.variance, amounts[:, 0]), amounts, doubts, common.free
    )


def no_input_noise(records: int) -> InputNoise:
    """Return no noise of the reference, of so many records."""
    free = np.zeros(records, dtype=bool)
    return InputNoise(np.zeros(records), np.zeros((records, 3)), np.zeros((records, 5)), free)


def by_amounts(amounts: FloatArray, bins: int) -> FloatArray:
    """Return a + c/k + d/k² at each bin k, shape (R, K)."""
    flicker = flicker_of(bins)
    level = amounts[:, 2:3] * flicker
    level += amounts[:, 1:2]
    level *= flicker
    level += amounts[:, :1]
    return level


def _at_bins(amounts: FloatArray, bins: int, by_reference: FloatArray | float = 0.0) -> FloatArray:
    """Return the noise of the response and that from the reference, positive, shape (R, K)."""
    shape = by_amounts(amounts, bins)
    shape += by_reference
    return np.maximum(shape, MIN_LEVEL * np.mean(shape, axis=1, keepdims=True), out=shape)


def flicker_of(bins: int) -> FloatArray:
    """Return 1/k at each bin k; at bin 0, which does not count, as at bin 1."""
    return 1.0 / np.maximum(np.arange(bins), 1.0)

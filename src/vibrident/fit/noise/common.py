"""Noise of the reference, from the correlation of residual and prediction.

Noise n of the reference appears in the prediction as H n and in the residual as −H n, so −Re Ŷ* R
has the mean |H|² σx². Bins without excitation determine it best, and each bin is weighted by its
scatter with motion. An error of the model gives a fraction of |Ŷ|², with a slope in f², where that
is motion: where n may be all of it, it looks like |H|² σx². Noise is white, 1/f, both, or 1/f².
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.information import MIN_SCALED_EIGENVALUE, inverse_normal, inverse_where_shown
from vibrident.fit.noise.averages import averaged_bins, typical, windowed
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: σx² is significant above this many standard deviations.
SIGNIFICANT_DEVIATIONS = 4.0
#: A bin is without motion where the prediction is less than so many times that due to noise.
QUIET_RATIO = 4.0
#: Fewest bins that must be without motion.
MIN_QUIET_BINS = 48
#: Bins beyond this many times their surroundings are left out: one of 400 white ones is.
MAX_POWER_RATIO = 6.0
#: Variance of a mean over powers of bins under a Hann window, over that of independent bins.
WINDOWED_VARIANCE = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)


class CommonNoise(NamedTuple):
    """Noise of the reference of R records: σx² = a + c/k + d/k² at bin k.

    Attributes:
        variance: mean of σx² over the bins, shape (R,).
        spread: its standard deviation; infinite where motion leaves no bin free, shape (R,).
        amounts: a, c and d, shape (R, 3).
        covariance: of a and c where neither is left out, shape (R, 2, 2).
        free: whether enough bins hold no motion, shape (R,).
    """

    variance: FloatArray
    spread: FloatArray
    amounts: FloatArray
    covariance: FloatArray
    free: BoolArray

    @property
    def significant(self) -> BoolArray:
        """Return where the noise is significant, shape (R,)."""
        return self.variance > SIGNIFICANT_DEVIATIONS * self.spread


def common_noise(
    noise: ComplexArray,
    predicted: ComplexArray,
    through: FloatArray,
    count: FloatArray,
    last: int,
) -> CommonNoise:
    """Return an estimate of the noise of the reference.

    Args:
        noise: component of the residual that is locally incoherent with the motion, shape (R, K).
        predicted: shape (R, K).
        through: power of such noise of variance one behind the sensor, shape (R, K) or (1, K).
        count: samples used, shape (R, 1).
        last: bins from here on do not count.
    """
    bins = slice(0, last + 1)
    residual = windowed(noise[:, bins])
    motion = windowed(predicted[:, bins])
    share = through[:, 1:last]
    width = averaged_bins(noise.shape[1])
    common = -(motion.real * residual.real + motion.imag * residual.imag) / count
    level = typical(power_of(residual), width) / count
    power = power_of(motion) / count
    motion_level = typical(power, width)
    shapes = np.arange(1.0, last) ** np.array([[0.0], [-1.0], [-2.0]])
    loud = motion_level * (motion_level >= QUIET_RATIO * level)
    chance = (power < MAX_POWER_RATIO * motion_level) * (2.0 / WINDOWED_VARIANCE)
    product = motion_level * level
    noise_level: FloatArray | float = 0.0
    amounts = np.zeros((len(noise), 3))
    variances = np.zeros(0)
    normal = np.zeros(0)
    for _ in range(2):
        weight = chance / np.maximum(np.square(noise_level) + product, 1e-300)
        normal, right = _normal_equations(share, loud, common, weight, last)
        amounts, variances = _amounts(normal, right)
        noise_level = share * (amounts @ shapes)
    mean = np.mean(shapes, axis=1)
    spread = np.sqrt(np.maximum(mean @ variances @ mean, 0.0))
    quiet = QUIET_RATIO * level
    free = np.sum(motion_level < quiet, axis=1) >= MIN_QUIET_BINS
    # Where motion is everywhere, an error of the model cannot be separated from noise.
    limit = np.maximum(quiet, QUIET_RATIO * noise_level)
    separable = np.sum(motion_level < limit, axis=1) >= MIN_QUIET_BINS
    spread = np.where(separable, spread, np.inf)
    covariance = inverse_normal(normal[:, :2, :2])
    return CommonNoise(amounts @ mean, spread, amounts, covariance, free)


def _normal_equations(
    share: FloatArray, loud: FloatArray, common: FloatArray, weight: FloatArray, last: int
) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations of noise in 1, 1/k and 1/k², with the motion projected out.

    The motion has a fraction of its own and one in k². Of a single tone these are alike: they are
    projected out by as many as are separable.

    Args:
        share: power of noise of variance one behind the sensor, shape (R, n) or (1, n).
        loud: power of the motion, shape (R, n).
        common: product of residual and prediction, shape (R, n).
        weight: shape (R, n).
        last: the bin after these.

    Returns:
        The normal matrices, shape (R, 3, 3), and right sides, shape (R, 3).
    """
    place = np.arange(1.0, last)
    powers = (place / last) ** np.array([0.0, 2.0, 4.0])[:, None]
    inverses = place ** -np.arange(5.0)[:, None]
    mixed = np.concatenate([inverses[:3], powers[1] * inverses[:3]])
    weighted_noise = weight * share
    weighted_motion = weight * loud
    noise_sums = (weighted_noise * share) @ inverses.T
    motion_sums = (weighted_motion * loud) @ powers.T
    mixed_sums = (weighted_noise * loud) @ mixed.T
    noise = noise_sums[:, np.add.outer(np.arange(3), np.arange(3))]
    motion = motion_sums[:, [[0, 1], [1, 2]]]
    products = mixed_sums.reshape(-1, 2, 3).swapaxes(1, 2)
    imitated = products @ inverse_where_shown(motion)
    noise_right = (weighted_noise * common) @ inverses[:3].T
    motion_right = (weighted_motion * common) @ powers[:2].T
    right = noise_right - (imitated @ motion_right[..., None])[..., 0]
    return noise - imitated @ np.swapaxes(products, 1, 2), right


def _amounts(normal: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least-squares amounts of R records by their normal equations.

    They are the first two where neither is negative and the second is significant beside the
    first; else one: the first, unless another alone explains significantly more.

    Returns:
        The amounts, shape (R, 3), and their covariances, shape (R, 3, 3).
    """
    power = np.diagonal(normal, axis1=1, axis2=2)
    scale = np.sqrt(np.where(power > 0.0, power, 1.0))
    size = scale[:, :, None] * scale[:, None]
    normal = normal / size
    right = right / scale
    covariance = np.zeros_like(normal)
    covariance[:, :2, :2] = inverse_normal(normal[:, :2, :2])
    amounts = (covariance @ right[..., None])[..., 0]
    limit = SIGNIFICANT_DEVIATIONS * np.sqrt(covariance[:, 1, 1])
    with_one_shape = np.flatnonzero(~((amounts[:, 0] >= 0.0) & (amounts[:, 1] > limit)))
    variances = 1.0 / np.maximum(
        np.diagonal(normal[with_one_shape], axis1=1, axis2=2), MIN_SCALED_EIGENVALUE
    )
    explained = variances * right[with_one_shape] * np.maximum(right[with_one_shape], 0.0)
    explained[:, 0] += SIGNIFICANT_DEVIATIONS**2
    shape = np.argmax(explained, axis=1)
    rows = np.arange(len(with_one_shape))
    amounts[with_one_shape] = 0.0
    amounts[with_one_shape, shape] = variances[rows, shape] * right[with_one_shape, shape]
    covariance[with_one_shape] = 0.0
    covariance[with_one_shape, shape, shape] = variances[rows, shape]
    amounts = np.maximum(amounts, 0.0)
    return amounts / scale, covariance / size

"""Noise of the reference by what residual and prediction have in common.

Noise n of the reference appears in the prediction as H n and in the residual as −H n, so −Re Ŷ* R
has the mean |H|² σx². Bins without excitation determine it best, and each bin is weighted by its
scatter with motion. An error of the model gives a share of |Ŷ|², with a slope in f², where that is
motion: where n may be all of it, it looks like |H|² σx². White and 1/f noise are separated.
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
#: A bin is without motion where the prediction is less than so many times what noise makes there.
QUIET_RATIO = 4.0
#: So many bins must be without motion.
MIN_QUIET_BINS = 48
#: Bins beyond this many times their surroundings are left out: one of 400 white ones is.
FAR_RATIO = 6.0
#: Variance of a mean over powers of bins under Hann's window, over that of independent bins.
WINDOWED_VARIANCE = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)


class CommonNoise(NamedTuple):
    """Noise of the reference of R records, white and 1/f: σx² = a + c / k at bin k.

    Attributes:
        variance: mean of σx² over the bins, shape (R,).
        spread: its standard deviation; infinite where motion leaves no bin free, shape (R,).
        amounts: a and c, shape (R, 2).
        covariance: of both where neither is left out, shape (R, 2, 2).
        free: whether enough bins hold no motion, shape (R,).
    """

    variance: FloatArray
    spread: FloatArray
    amounts: FloatArray
    covariance: FloatArray
    free: BoolArray

    @property
    def significant(self) -> BoolArray:
        """Return where there is noise for sure, shape (R,)."""
        return self.variance > SIGNIFICANT_DEVIATIONS * self.spread


def common_noise(
    noise: ComplexArray,
    predicted: ComplexArray,
    through: FloatArray,
    count: FloatArray,
    last: int,
) -> CommonNoise:
    """Estimate noise of the reference.

    Args:
        noise: what of the residual is locally incoherent with the motion, shape (R, K).
        predicted: shape (R, K).
        through: power of such noise of variance one behind the sensor, shape (R, K) or (1, K).
        count: samples used, shape (R, 1).
        last: bins from here on are not looked at.
    """
    bins = slice(0, last + 1)
    rest, moved = windowed(noise[:, bins]), windowed(predicted[:, bins])
    share, width = through[:, 1:last], averaged_bins(noise.shape[1])
    common = -(moved.real * rest.real + moved.imag * rest.imag) / count
    level = typical(power_of(rest), width) / count
    power = power_of(moved) / count
    own = typical(power, width)
    place = np.arange(1.0, last)
    loud = own * (own >= QUIET_RATIO * level)
    chance = (power < FAR_RATIO * own) * (2.0 / WINDOWED_VARIANCE)
    product = own * level
    made: FloatArray | float = 0.0
    amounts, variances, normal = np.zeros((len(noise), 2)), np.zeros(0), np.zeros(0)
    for _ in range(2):
        weight = chance / np.maximum(np.square(made) + product, 1e-300)
        normal, right = _normal_equations(share, loud, common, weight, last)
        amounts, variances = _amounts(normal, right)
        made = share * (amounts[:, :1] + amounts[:, 1:2] / place)
    flicker = 1.0 / place
    mean = np.array([1.0, float(np.mean(flicker))])
    spread = np.sqrt(np.maximum(mean @ variances @ mean, 0.0))
    quiet = QUIET_RATIO * level
    free = np.sum(own < quiet, axis=1) >= MIN_QUIET_BINS
    # Motion everywhere: an error of the model cannot be separated from noise.
    shown = np.sum(own < np.maximum(quiet, QUIET_RATIO * made), axis=1) >= MIN_QUIET_BINS
    spread = np.where(shown, spread, np.inf)
    covariance = inverse_normal(normal)
    return CommonNoise(amounts @ mean, spread, amounts, covariance, free)


def _normal_equations(
    share: FloatArray, loud: FloatArray, common: FloatArray, weight: FloatArray, last: int
) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations of noise and its part in 1/k, beside shares of the motion.

    The motion has a share of its own and one in k². Of a lone tone these are alike: what they
    explain is taken out by as many as are told apart.

    Args:
        share: power of noise of variance one behind the sensor, shape (R, n) or (1, n).
        loud: power of the motion, shape (R, n).
        common: what residual and prediction have in common, shape (R, n).
        weight: shape (R, n).
        last: the bin behind these.

    Returns:
        The normal matrices, shape (R, 2, 2), and right sides, shape (R, 2).
    """
    place = np.arange(1.0, last)
    powers = (place / last) ** np.array([0.0, 2.0, 4.0])[:, None]
    inverses = place ** np.array([0.0, -1.0, -2.0])[:, None]
    mixed = np.stack([inverses[0], inverses[1], powers[1], powers[1] * inverses[1]])
    weighted = weight * share
    loudly = weight * loud
    of_noise = (weighted * share) @ inverses.T
    of_motion = (loudly * loud) @ powers.T
    across = (weighted * loud) @ mixed.T
    noise = of_noise[:, [[0, 1], [1, 2]]]
    motion = of_motion[:, [[0, 1], [1, 2]]]
    both = across[:, [[0, 2], [1, 3]]]
    imitated = both @ inverse_where_shown(motion)
    felt = (weighted * common) @ inverses[:2].T
    moved = (loudly * common) @ powers[:2].T
    right = felt - (imitated @ moved[..., None])[..., 0]
    return noise - imitated @ np.swapaxes(both, 1, 2), right


def _amounts(normal: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve least squares of R records by their normal equations.

    No amount is negative; the second is left out where it is not significant.

    Returns:
        The amounts, shape (R, 2), and their covariances, shape (R, 2, 2).
    """
    power = np.diagonal(normal, axis1=1, axis2=2)
    scale = np.sqrt(np.where(power > 0.0, power, 1.0))
    size = scale[:, :, None] * scale[:, None]
    normal, right = normal / size, right / scale
    covariance = inverse_normal(normal)
    amounts = (covariance @ right[..., None])[..., 0]
    least = SIGNIFICANT_DEVIATIONS * np.sqrt(covariance[:, 1, 1])
    without = ~((amounts[:, 0] >= 0.0) & (amounts[:, 1] > least))
    variance = 1.0 / np.maximum(normal[without, 0, 0], MIN_SCALED_EIGENVALUE)
    amounts[without] = 0.0
    amounts[without, 0] = variance * right[without, 0]
    covariance[without] = 0.0
    covariance[without, 0, 0] = variance
    amounts = np.maximum(amounts, 0.0)
    return amounts / scale, covariance / size

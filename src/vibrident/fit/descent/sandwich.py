"""Covariance of a least-squares estimate when the residual is not white.

With J the (weighted) Jacobian and S(f) the residual's spectrum, relative to white noise of the
variance used as weight,

    cov = (JᵀJ)⁻¹ [Σ_f S(f) J(f) J(f)ᴴ] (JᵀJ)⁻¹

(Ljung 1999, sec. 9.4; White's sandwich in frequency). S is the periodogram of the record, averaged
over the lines around each line. White noise gives (JᵀJ)⁻¹ back, up to the scatter of the spectrum;
hum, drift and 1/f noise count at their frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.bins import RecordBins
from vibrident.fit.information import inverse_root, sandwich_covariance
from vibrident.fit.noise.averages import NEAREST_BINS, mean_around
from vibrident.fit.response.transform import in_blocks, power_of

#: Fewest lines averaged on either side …
MIN_LINES = 12
#: … and most.
MAX_LINES = 200


def averaging_width(samples: int, share: float) -> int:
    """Return the number of lines averaged on either side of each, a share of the spectrum."""
    return int(np.clip(samples * share, MIN_LINES, MAX_LINES))


def hac_covariance(
    lines: Sequence[RecordBins], degrees: FloatArray, prior: FloatArray | float = 0.0
) -> tuple[FloatArray, float]:
    """Return the covariance of the parameters, shape (P, P), and its degrees of freedom.

    Args:
        lines: the records at the optimum of equal weights.
        degrees: degrees of freedom of each, shape (records,).
        prior: information of the fit in addition to the data, shape (P, P).
    """
    information = prior
    middle = np.zeros((1, 1))
    freedom = 0.0
    for record, record_freedom in zip(lines, degrees, strict=True):
        if record.count == 0.0:
            continue
        power = power_of(record.residual) / record.count
        if record.count < 4 * MIN_LINES:  # too few lines for a mean around each
            level = np.ones_like(power)
            freedom += max(float(record_freedom), 1.0)
        else:
            width = averaging_width(record.samples, 1 / 256)
            level = mean_around(power[None], width)[0]
            freedom += 4.0 * (width - NEAREST_BINS)
        level = np.maximum(level, record.floor)
        weight = record.counts / record.samples
        for block in in_blocks(len(weight)):  # copies of a block, not of everything
            slopes = record.jacobian[:, block]
            conjugate = np.conj(slopes).T
            weighted = slopes * weight[block]
            information = information + np.real(weighted @ conjugate)
            middle = middle + np.real((weighted * level[block]) @ conjugate)
    matrix = np.asarray(information)
    return sandwich_covariance(inverse_root(matrix), middle, matrix), freedom

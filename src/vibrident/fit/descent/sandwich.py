"""Covariance of a least-squares estimate when the residual is not white.

With J the (weighted) Jacobian and S(f) the residual's spectrum, relative to white noise of the variance used as weight,

    cov = (JᵀJ)⁻¹ [Σ_f S(f) J(f) J(f)ᴴ] (JᵀJ)⁻¹                    (Ljung 1999, sec. 9.4; White's sandwich in frequency)

S is the record's own periodogram, averaged over the lines around each line. White noise gives (JᵀJ)⁻¹ back, up to the
spectrum's own scatter; hum, drift and 1/f noise count at their own frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.bins import RecordBins
from vibrident.fit.information import inverse_root, sandwich_covariance
from vibrident.fit.noise.averages import NEAREST_BINS, mean_around
from vibrident.fit.response.transform import in_blocks, power_of

#: Fewest lines averaged on either side.
FEWEST = 12


def width(samples: int, share: float) -> int:
    """Lines averaged on either side of each: a share of the spectrum."""
    return int(np.clip(samples * share, FEWEST, 200))


def hac_covariance(
    lines: Sequence[RecordBins], degrees: FloatArray, prior: FloatArray | float = 0.0
) -> tuple[FloatArray, float]:
    """Covariance of the parameters, shape (P, P), and the degrees of freedom behind it.

    Args:
        lines: the records at the optimum of equal weights.
        degrees: degrees of freedom of each, shape (records,).
        prior: information that the fit had beside the data, shape (P, P).
    """
    information, middle, freedom = prior, np.zeros((1, 1)), 0.0
    for record, own in zip(lines, degrees, strict=True):
        if record.count == 0.0:
            continue
        power = power_of(record.residual) / record.count
        if record.count < 4 * FEWEST:  # too few lines for a mean around each
            level, told = np.ones_like(power), max(float(own), 1.0)
        else:
            around = width(record.samples, 1 / 256)
            level, told = mean_around(power[None], around)[0], 4.0 * (around - NEAREST_BINS)
        level, weight = np.maximum(level, record.floor), record.counts / record.samples
        freedom += told
        for block in in_blocks(len(weight)):  # copies of a block, not of everything
            slopes = record.jacobian[:, block]
            conjugate, weighted = np.conj(slopes).T, slopes * weight[block]
            information = information + np.real(weighted @ conjugate)
            middle = middle + np.real((weighted * level[block]) @ conjugate)
    whole = np.asarray(information)
    return sandwich_covariance(inverse_root(whole), middle, whole), freedom

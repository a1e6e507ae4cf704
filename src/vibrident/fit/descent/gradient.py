"""Covariance of the gradient of V at an estimate, by the spectrum of the residual.

It is the middle of the sandwich (White 1980; Ljung 1999, sec. 9.4): the noise assumed in the
weights may differ from that of the residual around each bin.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.descent.in_noise import GroupAt
from vibrident.fit.descent.sandwich import averaging_width
from vibrident.fit.group.network import products
from vibrident.fit.noise.averages import NEAREST_BINS, mean_around
from vibrident.fit.noise.spectrum import NoiseSpectrum
from vibrident.fit.response.transform import power_of

#: Share of the samples whose bins are averaged on either side of each.
AVERAGED_SHARE = 1 / 128


def gradient_covariance(
    place: GroupAt, spectra: Sequence[NoiseSpectrum], fitted: FloatArray, floors: FloatArray
) -> tuple[FloatArray, float]:
    """Return the covariance of the gradient, shape (P, P), and its degrees of freedom.

    Args:
        place: the group at the estimate.
        spectra: noise of each segment at the group's bins.
        fitted: count of numbers that were fitted to each segment, shape (R,).
        floors: lower limits of the noise of each segment, shape (R,).
    """
    averaged = averaging_width(place.group.grid.samples, AVERAGED_SHARE)
    excited = np.stack([spectrum.excited for spectrum in spectra])
    power = power_of(place.rows.residual) / (place.group.count[:, None] * place.psd)
    power[:, 0] = power[:, 1]  # bin 0 holds an offset
    # Bins that do not count carry no information on the noise of those that do.
    sums, weight_sums = (mean_around(rows, averaged) for rows in (power * excited, excited))
    # The residual lacks what was fitted (MacKinnon & White 1985).
    correction = place.numbers / np.maximum(place.numbers - fitted, 1.0)
    sums = sums * correction[:, None]
    # Sums over no bin that counts are rounding of those over all before it.
    rounding = np.finfo(float).eps * excited.sum(axis=1, keepdims=True)
    local = np.divide(sums, weight_sums, out=np.zeros_like(sums), where=weight_sums > rounding)
    local = np.maximum(local, floors[:, None] / place.psd)
    weighted = place.jacobian * (place.weight * excited * local)[:, None]
    covariance = np.sum(products(weighted, place.jacobian), axis=0)
    return covariance, len(spectra) * 4.0 * (averaged - NEAREST_BINS)


def reference_pull(place: GroupAt, row: int, doubt: FloatArray) -> FloatArray:
    """Return the pull on the gradient of noise of the reference that may remain (95 %), (P,).

    Args:
        place: the group at the estimate.
        row: of the segment in the group.
        doubt: such noise at each bin, shape (K,).
    """
    weighted = place.through * (place.weight[row] * place.group.grid.samples * doubt)
    return products(place.turns, weighted[None])[:, 0]

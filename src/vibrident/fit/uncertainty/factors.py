"""Measured over modelled response, band by band, at the bins and with the weights of a fit.

Let R be the residual, Ŷ the response to the most likely motion, W the weights of the bins and P the
projection off the nuisance columns N in W. The columns D = Ŷ·1[band] and jŶ·1[band] have the score
s = D*WPR and the information G = D*WPD. Then ρ = G⁻¹ s is measured over modelled response less one,
with the covariance G⁻¹, and s*G⁻¹s is χ² with two degrees of freedom. The fit makes the scores of
its own columns vanish, so that χ² of all bands together loses one degree of freedom a parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import fft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.descent.weighted_bins import WeightedBins
from vibrident.fit.group.network import products
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.noise.averages import NEAREST_BINS, averaged_bins
from vibrident.fit.noise.profile import slow_profile
from vibrident.fit.response.bands import MIN_RELATIVE_POWER, band_edges
from vibrident.fit.response.response import MIN_RELATIVE_DEVIATION, ComplexArray
from vibrident.fit.response.transform import (
    MIN_SPECTRUM_SAMPLES,
    band_of,
    band_sums,
    hann,
    power_of,
)

#: A factor whose real part has a larger standard deviation than this is left out.
MAX_DEVIATION = 0.5
#: Smaller eigenvalue of a band's information over the larger one; below it the nuisances imitate
#: the band, and the remainder is rounding.
MIN_EIGENVALUE_RATIO = 1e-3
#: Share of the noise's degrees of freedom that the projection of the motion leaves: 21 of 24 bins.
FREE_SHARE = 0.875
#: Doubt of the part of the noise that is the reference's: half of none to all.
SHARE_DOUBT = 0.5
#: Half-overlapping stretches of a record over which the motion of its bands is followed.
STRETCHES = 15


@dataclass(frozen=True, eq=False)
class Factors:
    """Factors of the bands of a record in which the motion shows, each of shape (bands,).

    Attributes:
        place: centre of the band, in bins.
        rho: measured over modelled response, less one.
        deviation: standard deviation of its real part.
        squares: χ² of two degrees of freedom, over noise of ``freedom``.
        freedom: degrees of freedom of the noise.
        unweighted: the variance of ρ over that by noise of one level in all bins, at most one.
    """

    place: FloatArray
    rho: ComplexArray
    deviation: FloatArray
    squares: FloatArray
    freedom: FloatArray
    unweighted: FloatArray


def band_factors(
    bins: WeightedBins, *, sine: bool, least: FloatArray | float = 0.0
) -> Factors | None:
    """Return the factors of a record's bands, or None where no band holds enough motion.

    Args:
        bins: of the record.
        sine: whether all bins are one band.
        least: smallest variance of the noise, a sample, shape (bins,).
    """
    last = bins.residual.size
    edges = distinct(np.minimum(band_edges(bins.samples, 1.0).astype(int), last))
    edges = np.array([1, last]) if sine else edges
    if edges[-1] <= edges[0]:
        return None
    motion = motion_bins(bins)
    counted = bins.counts * (bins.spectrum.excited > 0.5)
    # Unlike the fit's weights these do not fade out where noise of the reference may be the motion,
    # so that cov s = G.
    weights = counted / (bins.samples * bins.spectrum.psd)
    freed, information, score, nuisance_information = _scores(bins, motion, weights, edges)
    # Where no bin counts, nuisances are of any size.
    motion_power = power_of(motion) * (weights > 0.0)
    power = band_sums(motion_power, edges)
    moment = band_sums(np.arange(last) * motion_power, edges)
    flat = band_sums(counted * motion_power, edges)
    strongest = np.diff(edges) * float(np.max(power / np.diff(edges)))
    # Information of the two real columns, less what the nuisances imitate.
    real_information = information - nuisance_information[0]
    imaginary_information = information - nuisance_information[1]
    cross_information = -nuisance_information[2]
    determinant = real_information * imaginary_information - cross_information**2
    trace = real_information + imaginary_information
    shows = (power > MIN_RELATIVE_POWER * strongest) & (
        determinant > MIN_EIGENVALUE_RATIO * trace**2 / 4.0
    )
    shows &= trace * MAX_DEVIATION**2 > 2.0
    if not shows.any():
        return None
    divisor = np.where(shows, determinant, 1.0)
    rho = (
        imaginary_information * score.real
        - cross_information * score.imag
        + 1j * (real_information * score.imag - cross_information * score.real)
    ) / divisor
    variance = 0.5 * trace / divisor
    squares = rho.real * score.real + rho.imag * score.imag
    unexplained = freed - np.where(shows, rho, 0.0)[band_of(np.arange(last), edges)] * motion * (
        weights > 0.0
    )
    power_ratio, steadiness = _unsteady_noise(
        bins, unexplained * np.sqrt(weights), motion * np.sqrt(weights), edges
    )
    unweighted = np.minimum(1.0, variance * flat / bins.samples)
    variance_limit = (
        0.5 * bins.count * band_sums(np.broadcast_to(least, last), edges) / np.diff(edges)
    )
    variance_limit = np.maximum(variance_limit, MIN_RELATIVE_DEVIATION**2 * strongest)
    variance_limit /= np.where(shows, power, 1.0)
    variance_raised = np.maximum(variance * power_ratio, variance_limit)
    bias = _bias(bins, band_sums(counted, edges), np.where(shows, 0.5 * trace, 1.0))
    variance_raised += 0.5 * bias**2
    squares *= variance / variance_raised
    place = moment / np.maximum(power, 1e-300)
    freedom = np.full(len(rho), steadiness * noise_freedom(bins))
    deviation = np.sqrt(variance_raised)
    return Factors(
        place[shows],
        rho[shows],
        deviation[shows],
        squares[shows],
        freedom[shows],
        unweighted[shows],
    )


def _bias(bins: WeightedBins, count: FloatArray, information: FloatArray) -> FloatArray:
    """Return the standard deviation of a factor's real part by its bias, shape (bands,).

    Noise of the reference that the most likely motion still holds is in the residual, too. Where
    the part of the noise that is the reference's is off by ε, each bin adds −ε to the score. At a
    single bin no shape tells that part, which is between none and all.

    Args:
        bins: of the record.
        count: number of bins that count in each band, twice those inside, shape (bands,).
        information: of the factor's real part, shape (bands,).
    """
    if bins.spectrum.input_noise == 0.0:
        return np.zeros(len(count))
    return SHARE_DOUBT * count / information


def noise_freedom(bins: WeightedBins) -> float:
    """Return the degrees of freedom of the noise level at a bin."""
    if bins.count < MIN_SPECTRUM_SAMPLES:
        return max(bins.count - 2.0 - len(bins.nuisances), 2.0)
    return 4.0 * (averaged_bins(bins.residual.size) - NEAREST_BINS) * FREE_SHARE


def motion_bins(bins: WeightedBins) -> ComplexArray:
    """Return the response to the most likely motion, shape (bins,)."""
    motion = bins.predicted + bins.passed_noise * bins.residual / bins.spectrum.psd
    motion[0] = 0.0
    return motion


def _scores(
    bins: WeightedBins, motion: ComplexArray, weight: FloatArray, edges: NDArray[np.int_]
) -> tuple[ComplexArray, FloatArray, ComplexArray, list[FloatArray]]:
    """Return the residual freed of the nuisances, and information and score of each band.

    Returns:
        The residual freed of the nuisances, shape (bins,); information and score of each band,
        shape (bands,); the information that the nuisances take from the real column, the imaginary
        column and their product.
    """
    rows = np.concatenate([bins.nuisances, bins.residual[None]])
    gram = products(rows * weight, rows)
    inverse = inverse_where_shown(gram[:-1, :-1])
    weighted_motion = weight * np.conj(motion)
    freed = bins.residual - (inverse @ gram[:-1, -1]) @ bins.nuisances
    cross = band_sums(weighted_motion * bins.nuisances, edges)
    real = np.real(cross)
    imaginary = np.imag(cross)
    pairs = (real, inverse @ real), (imaginary, inverse @ imaginary), (real, inverse @ imaginary)
    nuisance_information = [np.sum(first * second, axis=0) for first, second in pairs]
    return (
        freed,
        band_sums(weight * power_of(motion), edges),
        band_sums(weighted_motion * freed, edges),
        nuisance_information,
    )


def _unsteady_noise(
    bins: WeightedBins, residual: ComplexArray, motion: ComplexArray, edges: NDArray[np.int_]
) -> tuple[FloatArray, float]:
    """Return the noise power while each band moves over its mean, and the noise's steadiness.

    The first has shape (bands,) and is at least one; the second is at most one. A sweep passes each
    band in a moment, when changing noise differs from its mean.

    Args:
        bins: of the record.
        residual: whitened, less the factors, so that no misfit counts.
        motion: whitened.
        edges: of the bands.
    """
    samples = bins.samples
    used = bins.used
    if samples <= STRETCHES:  # too short to follow
        return np.ones(len(edges) - 1), 1.0
    noise_power = slow_profile(fft.irfft(residual, samples), used)
    half = fast_length(-(-samples // (STRETCHES + 1)))
    length = 2 * half
    begins = np.arange(STRETCHES + 2) * half  # from half a stretch before the record on
    padding = half, (STRETCHES + 2) * half - samples
    padded_motion = np.pad(fft.irfft(motion, samples), padding)
    padded_power = np.pad(noise_power, padding, mode="edge")
    motion_stretches = sliding_window_view(padded_motion, length)[begins]
    power_stretches = sliding_window_view(padded_power, length)[begins]
    first = edges[:-1] * length // samples
    end = -(-edges[1:] * length // samples)
    lines = power_of(fft.rfft(motion_stretches * hann(length))[:, : end[-1]])
    total = np.cumsum(np.pad(lines, ((0, 0), (1, 0))), axis=1)
    motion_power = total[:, np.minimum(end, total.shape[1] - 1)] - total[:, first]
    shares = motion_power / np.maximum(np.sum(motion_power, axis=0), 1e-300)
    mean = float(np.mean(noise_power))
    # Noise of the whole record leaks into a band, whenever that moves: not below the mean.
    ratio = np.maximum(np.mean(power_stretches, axis=1) @ shares / mean, 1.0)
    return ratio, mean**2 / float(np.mean(noise_power**2))

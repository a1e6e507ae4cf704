"""Measured over modelled response, band by band, at the bins and with the weights of a fit.

With R the residual, Ŷ the response to the most likely motion, W the weights of the bins and P the projection off the
nuisance columns N in W, the columns D = Ŷ·1[band] and jŶ·1[band] have the score s = D*WPR and the information
G = D*WPD. Then ρ = G⁻¹ s is measured over modelled response less one, with the covariance G⁻¹, and s*G⁻¹s is χ² with
two degrees of freedom. The fit makes the scores of its own columns vanish, so that χ² of all bands together has as many
degrees of freedom less as there are parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy import fft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.base.tails import chi2_tail
from vibrident.data.records import FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.descent.weighed import Weighed
from vibrident.fit.group.network import products
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.noise.averages import NEAREST_BINS, averaged_bins
from vibrident.fit.noise.profile import slow_profile
from vibrident.fit.response.bands import MIN_RELATIVE_POWER, band_edges
from vibrident.fit.response.response import MIN_RELATIVE_DEVIATION, ComplexArray
from vibrident.fit.response.transform import MIN_SPECTRUM_SAMPLES, hann, power_of

#: A factor whose real part has a larger standard deviation than this says nothing.
MAX_DEVIATION = 0.5
#: The smaller eigenvalue of a band's information over the larger one: less is rounding of what the nuisances imitate.
MIN_EIGENVALUE = 1e-3
#: Share of the noise's degrees of freedom that the projection of the motion leaves (three of 24 bins go).
FREE_SHARE = 0.875
#: Stretches of a record, each half the next one's too, in which its bands move.
STRETCHES = 15
#: Noise changes with time where chance makes its stretches as uneven with less than this probability.
STEADY_CHANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Factors:
    """Factors of the bands of a record in which the motion shows, each of shape (bands,).

    Attributes:
        place: centre of the band, in bins.
        rho: measured over modelled response, less one.
        deviation: standard deviation of its real part.
        squares: χ² of two degrees of freedom, over noise of ``freedom``.
        freedom: degrees of freedom of the noise.
        unweighted: the variance of ρ over what it would be if the noise had one level in all bins, at most one.
    """

    place: FloatArray
    rho: ComplexArray
    deviation: FloatArray
    squares: FloatArray
    freedom: FloatArray
    unweighted: FloatArray


def band_factors(bins: Weighed, *, sine: bool, least: FloatArray | float = 0.0) -> Factors | None:
    """Return the factors of a record's bands, or None where no band holds enough of the motion.

    ``sine``: all bins are one band; ``least``: variance, a sample, that no noise is below, shape (bins,).
    """
    last = bins.residual.size
    edges = distinct(np.minimum(band_edges(bins.samples, 1.0).astype(int), last))
    edges = np.array([1, last]) if sine else edges
    if edges[-1] <= edges[0]:
        return None
    motion, moves = motion_bins(bins), bins.counts * (bins.spectrum.excited > 0.5)
    # The fit's weights fade out where noise of the reference may be the motion; these do not, so that cov s = G.
    weight = moves / (bins.samples * bins.spectrum.psd)
    left, gain, score, spent = _scores(bins, motion, weight, edges)
    power, moment, flat = (
        _sums(each, edges)
        for each in (power_of(motion), np.arange(last) * power_of(motion), moves * power_of(motion))
    )
    strongest = np.diff(edges) * float(np.max(power / np.diff(edges)))
    # Of two real columns: the information less what the nuisances imitate.
    first, second, both = gain - spent[0], gain - spent[1], -spent[2]
    determinant, trace = first * second - both**2, first + second
    kept = (power > MIN_RELATIVE_POWER * strongest) & (
        determinant > MIN_EIGENVALUE * trace**2 / 4.0
    )
    kept &= trace * MAX_DEVIATION**2 > 2.0
    if not kept.any():
        return None
    safe = np.where(kept, determinant, 1.0)
    rho = (
        second * score.real - both * score.imag + 1j * (first * score.imag - both * score.real)
    ) / safe
    variance, squares = 0.5 * trace / safe, rho.real * score.real + rho.imag * score.imag
    rest = left - np.where(kept, rho, 0.0)[_band_of(edges, last)] * motion * (weight > 0.0)
    uneven, even = _while_moving(bins, rest * np.sqrt(weight), motion * np.sqrt(weight), edges)
    own = np.minimum(1.0, variance * flat / bins.samples)
    lowest = 0.5 * bins.count * _sums(np.broadcast_to(least, last), edges) / np.diff(edges)
    lowest = np.maximum(lowest, MIN_RELATIVE_DEVIATION**2 * strongest) / np.maximum(power, 1e-300)
    floor = np.maximum(variance * uneven, lowest)
    squares *= variance / floor
    place, freedom = (
        moment / np.maximum(power, 1e-300),
        np.full(len(rho), even * noise_freedom(bins)),
    )
    every: tuple[Any, ...] = (place, rho, np.sqrt(floor), squares, freedom, own)
    return Factors(*(each[kept] for each in every))


def noise_freedom(bins: Weighed) -> float:
    """Degrees of freedom of the level of the noise at a bin."""
    if bins.count < MIN_SPECTRUM_SAMPLES:
        return max(bins.count - 2.0 - len(bins.nuisances), 2.0)
    return 4.0 * (averaged_bins(bins.residual.size) - NEAREST_BINS) * FREE_SHARE


def motion_bins(bins: Weighed) -> ComplexArray:
    """Response to the most likely motion, shape (bins,)."""
    motion = bins.predicted + bins.passed_noise * bins.residual / bins.spectrum.psd
    motion[0] = 0.0
    return motion


def _scores(
    bins: Weighed, motion: ComplexArray, weight: FloatArray, edges: NDArray[np.int_]
) -> tuple[ComplexArray, FloatArray, ComplexArray, list[FloatArray]]:
    """Residual beside the nuisances, shape (bins,); of each band information and score, and what nuisances take of it.

    The last for the two columns of a band, and for their product.
    """
    rows = np.concatenate([bins.nuisances, bins.residual[None]])
    gram = products(rows * weight, rows)
    inverse = inverse_where_shown(gram[:-1, :-1])
    turned = weight * np.conj(motion)
    left = bins.residual - (inverse @ gram[:-1, -1]) @ bins.nuisances
    common = np.add.reduceat((turned * bins.nuisances)[:, : edges[-1]], edges[:-1], axis=1)
    real, imaginary = np.real(common), np.imag(common)
    pairs = (real, inverse @ real), (imaginary, inverse @ imaginary), (real, inverse @ imaginary)
    spent = [np.sum(one * other, axis=0) for one, other in pairs]
    return left, _sums(weight * power_of(motion), edges), _sums(turned * left, edges), spent


def _sums(lines: NDArray, edges: NDArray[np.int_]) -> NDArray:
    """Sums over each band."""
    return np.add.reduceat(lines[: edges[-1]], edges[:-1])


def _band_of(edges: NDArray[np.int_], lines: int) -> NDArray[np.int_]:
    """Number of the band of each line; the first and the last beyond them."""
    return np.clip(np.searchsorted(edges, np.arange(lines), side="right") - 1, 0, len(edges) - 2)


def _while_moving(
    bins: Weighed, rest: ComplexArray, motion: ComplexArray, edges: NDArray[np.int_]
) -> tuple[FloatArray | float, float]:
    """Return the noise power while each band moves over its mean, shape (bands,), and how even it is in time.

    The first is at least one.

    A sweep passes a band in a moment; where noise grows within the record, that moment is not as noisy as the rest.

    Args:
        bins: of the record.
        rest: whitened, less the factors, so that no misfit counts.
        motion: whitened.
        edges: of the bands.
    """
    n, used = bins.samples, bins.used
    profile = slow_profile(np.asarray(fft.irfft(rest, n)), used)
    level = profile[:: max(n // (STRETCHES + 1), 1)]
    freedom = 2.0 * float(np.count_nonzero(rest)) / len(level)
    if (
        chi2_tail(
            len(level) - 1, 0.5 * freedom * float(np.sum((level / np.mean(level) - 1.0) ** 2))
        )
        > STEADY_CHANCE
    ):
        return 1.0, 1.0
    length = 2 * (n // (STRETCHES + 1))
    begins = np.arange(STRETCHES + 2) * (length // 2)  # from half a stretch before the record on
    moved = np.pad(np.asarray(fft.irfft(motion, n)), length // 2 + 1)
    around = np.pad(profile, length // 2 + 1, mode="edge")
    pieces = [sliding_window_view(each, length)[begins] for each in (moved, around)]
    lines = power_of(np.asarray(fft.rfft(pieces[0] * hann(length))))
    total = np.cumsum(np.pad(lines, ((0, 0), (1, 0))), axis=1)
    first, end = edges[:-1] * length // n, -(-edges[1:] * length // n)
    moves = total[:, np.minimum(end, total.shape[1] - 1)] - total[:, first]
    shares = moves / np.maximum(np.sum(moves, axis=0), 1e-300)
    mean = float(np.mean(profile))
    # What leaks into a band is of all the record, wherever the band moves: no quieter than the mean.
    return np.maximum(np.mean(pieces[1], axis=1) @ shares / mean, 1.0), mean**2 / float(
        np.mean(profile**2)
    )

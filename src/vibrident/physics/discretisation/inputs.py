"""The network's inputs in each step: Legendre coefficients of the input signal over the step.

They do not depend on the sensor's parameters and are computed once, before training. For a record
taken through an anti-alias filter the signal between samples is the band-limited one; its
coefficients over the step from t_k to t_{k+1} are weighted sums of the samples around it:

    c_j(k) = (2j + 1) ∫₀¹ a(t_k + x Ts) P_j(2x − 1) dx = Σ_n h_j[n] a_{k+n},

with h_j from the sinc in Kaiser's window (Oppenheim & Schafer 2010, sec. 7.5) without its jump,
corrected so that polynomials are interpolated exactly: of slow motion, the derivatives of the
interpolation's error would exceed those of the motion. The Legendre series of a signal below 0.4 fs
converges for every sensor, however stiff: the j-th coefficient of a tone falls like the spherical
Bessel function j_j(ω Ts/2), and the sensor's own j_j(λ Ts/2) multiplies it.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import fft
from numpy.polynomial import legendre
from numpy.typing import NDArray

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray

#: Highest frequency, as a fraction of the sampling rate, for which band-limited inputs are
#: accurate.
USABLE_BAND = 0.4
#: Samples used on either side of a step for inputs that are accurate over the usable band.
HALF_WIDTH = 40
#: Kaiser β for the half width above: interpolation error below 3e-11 up to 0.4 of the sampling
#: rate, and below 2e-4 up to 0.43. The error is as small at the edge f of another band if the half
#: width is in proportion to 1/(1 − 2 f), the width of what lies between the band and its images.
KAISER_BETA = 24.0
#: Highest degree of polynomials that are interpolated exactly: a second derivative is then right
#: to 1e-6 of a tone of a thousandth of the sampling rate …
MAX_DEGREE = 5
#: … and by how much it is less than the half width at least: with all taps no choice would be left.
MIN_FREE_TAPS = 3
#: Truncation error allowed for the Legendre series, relative to the response.
SERIES_TOLERANCE = 1e-10
#: Most Legendre coefficients a step.
MAX_TERMS = 12
#: Part of its largest value at which a filter's response ends: less than the interpolation's error.
KERNEL_TOLERANCE = 1e-9


@dataclass(frozen=True)
class StepInputs:
    """Legendre coefficients of the input over each step, aligned with the response samples.

    Step k's output, read at ``fraction`` of the step, belongs to response sample k.

    Attributes:
        coefficients: shape (steps, terms).
        usable: False where a sample that the coefficients need is missing or invalid, (steps,).
        fraction: where in the step the output is read, in [0, 1).
    """

    coefficients: FloatArray
    usable: BoolArray
    fraction: float


@dataclass(frozen=True)
class StepFilters:
    """Filters from samples to inputs.

    Input j of step k is Σ_i filters[j, i] samples[k + first + i].

    Attributes:
        filters: shape (terms, taps).
        first: sample of the first tap, counted from the step's.
        usable: shape (steps,); see :class:`StepInputs`.
        fraction: see :class:`StepInputs`.
    """

    filters: FloatArray
    first: int
    usable: BoolArray
    fraction: float


class Kernel(NamedTuple):
    """Interpolation from samples.

    Attributes:
        half_width: samples used on either side of a step.
        beta: of its Kaiser window.
    """

    half_width: int
    beta: float


def kernel_for(samples: int, band: float = USABLE_BAND) -> Kernel:
    """Return the interpolation that is accurate over a band; it is shorter for a short record.

    Args:
        samples: of the record.
        band: highest frequency at which inputs must be accurate, over the sampling rate.
    """
    needed = math.ceil(HALF_WIDTH * (1.0 - 2.0 * USABLE_BAND) / (1.0 - 2.0 * band))
    half_width = min(needed, max(4, samples // 5))
    return Kernel(half_width, KAISER_BETA * half_width / needed)


def terms_needed(rate_times_step: float, band: float = USABLE_BAND) -> int:
    """Return the number of Legendre terms for a sensor whose fastest rate is |λ|, given |λ| Ts.

    The truncation error is bounded by j_q(ω Ts/2) j_q(|λ| Ts/2) (2q + 1) for the largest ω in the
    band, with the second factor at most one. ``band`` is as of :func:`kernel_for`.
    """
    highest = math.pi * band  # ω Ts / 2
    for q in range(2, MAX_TERMS):
        # |j_q| of a complex rate is bounded by the modified function over its exponential growth.
        sensor = _spherical_bessel(q, rate_times_step / 2, 1.0)
        if (2 * q + 1) * abs(_spherical_bessel(q, highest, -1.0)) * sensor < SERIES_TOLERANCE:
            return q
    return MAX_TERMS


def _spherical_bessel(order: int, x: float, sign: float) -> float:
    """Return j_q(x) for sign −1, or i_q(x), one at most, for sign 1, by series (DLMF 10.53)."""
    term = math.prod(x / k for k in range(3, 2 * order + 2, 2))
    total = term
    for k in itertools.count(1):
        term *= sign * 0.5 * x * x / (k * (2 * order + 2 * k + 1))
        total += term
        if not total <= 1.0 or abs(term) < 1e-17 * abs(total):
            return min(1.0, total)
    raise AssertionError


@functools.lru_cache(maxsize=64)
def _filters(terms: int, kernel: Kernel, shift: float) -> NDArray[np.float64]:
    """Return h_j[n] for n = 1 − half_width … :func:`_last_tap`, shape (terms, taps).

    ``shift``: samples by which the step starts late, in [0, 1).
    """
    half_width = kernel.half_width
    offsets: FloatArray = np.arange(1.0 - half_width, _last_tap(kernel, shift) + 1.0) - shift
    nodes, node_weights = legendre.leggauss(terms + 24)
    x = 0.5 * (nodes + 1.0)
    distance = x[:, None] - offsets[None, :]
    weights: FloatArray = np.sinc(distance) * _window(distance, kernel)
    weights += _polynomial_correction(weights, x, offsets, half_width)
    # Gauss's quadrature; of a slow motion, the derivatives would enlarge its rounding errors, which
    # least squares leave out.
    root = np.sqrt(node_weights)
    basis = root[:, None] * legendre.legvander(nodes, terms - 1)
    filters: FloatArray = np.linalg.lstsq(basis, root[:, None] * weights)[0].astype(float)
    filters.flags.writeable = False
    return filters


def _last_tap(kernel: Kernel, shift: float) -> int:
    """Return the last sample that the interpolation over a step reaches, counted from the step's.

    A step that starts between two samples ends behind one more.
    """
    return kernel.half_width + (shift > 0.0)


def _polynomial_correction(
    weights: FloatArray, x: FloatArray, offsets: FloatArray, half_width: int
) -> FloatArray:
    """Return the smallest change by which an interpolation is exact for polynomials.

    Args:
        weights: of the samples in the signal between them, shape (points, taps).
        x: the points, in samples, shape (points,).
        offsets: the samples, shape (taps,).
        half_width: of the interpolation.

    Returns:
        Shape (points, taps).
    """
    degree = min(MAX_DEGREE, half_width - MIN_FREE_TAPS)
    at_samples = legendre.legvander(offsets / half_width, degree)
    at_points = legendre.legvander(x / half_width, degree)
    fade = np.clip(1.0 - (offsets / (half_width + 1)) ** 2, 0.0, None) ** 2
    weighted = fade[:, None] * at_samples
    amounts = np.linalg.solve(at_samples.T @ weighted, (at_points - weights @ at_samples).T)
    return np.asarray((weighted @ amounts).T)


@functools.lru_cache(maxsize=8)
def _spectra(terms: int, kernel: Kernel, shift: float, size: int) -> NDArray[np.complex128]:
    """Return the spectra of the reversed filters, shape (terms, size/2 + 1).

    Their product with a signal's spectrum is that of the correlation.
    """
    return fft.rfft(_filters(terms, kernel, shift)[:, ::-1], size, axis=-1)


def band_limited_inputs(
    samples: FloatArray, valid: BoolArray, terms: int, delay_samples: float
) -> StepInputs:
    """Return the Legendre coefficients of the band-limited signal through samples.

    Args:
        samples: equally spaced, shape (samples,).
        valid: steps whose interpolation would need an invalid sample are not usable, (samples,).
        terms: number of coefficients a step.
        delay_samples: delay of the response channel after the input, in samples; any sign.
    """
    n = samples.shape[0]
    lag = math.ceil(delay_samples)
    kernel = kernel_for(n)
    shift = lag - delay_samples  # step k starts at sample k − lag + shift
    last = _last_tap(kernel, shift)
    size = fast_length(n + kernel.half_width + last)
    spectrum = fft.rfft(np.where(valid, samples, 0.0), size)
    convolved = fft.irfft(spectrum * _spectra(terms, kernel, shift, size), size, axis=-1)
    # The reversed filter's first sample belongs to the last tap, so the step that starts at k sits
    # that many samples later.
    return _aligned(
        convolved[:, last : last + n].T,
        lag,
        band_limited_filters(valid, terms, delay_samples),
    )


def band_limited_filters(
    valid: BoolArray, terms: int, delay_samples: float, band: float = USABLE_BAND
) -> StepFilters:
    """Return the filters of :func:`band_limited_inputs`; invalid samples count as zero.

    ``band`` is as of :func:`kernel_for`.
    """
    kernel = kernel_for(valid.shape[0], band)
    first = 1 - kernel.half_width
    lag = math.ceil(delay_samples)
    shift = lag - delay_samples
    usable = _delay_mask(_all_valid(valid, first, _last_tap(kernel, shift)), lag)
    return StepFilters(_filters(terms, kernel, shift), first - lag, usable, 0.0)


def filtered(
    samples: FloatArray, valid: BoolArray, response: Callable[[FloatArray], NDArray[np.complex128]]
) -> tuple[FloatArray, BoolArray]:
    """Return the band-limited signal behind a filter, and where all the samples it needs are valid.

    Args:
        samples: equally spaced, shape (samples,).
        valid: shape (samples,).
        response: of the filter by frequencies over the sampling rate, up to one; of a signal of
            this length at most.
    """
    n = samples.shape[0]
    kernel = kernel_for(n)
    half = kernel.half_width
    size = fast_length(2 * n)
    # Half samples: the filter acts on the interpolated signal.
    late = np.arange(-half, half + 0.5, 0.5)
    interpolation = np.zeros(2 * size)
    interpolation[np.arange(-2 * half, 2 * half + 1)] = 0.5 * np.sinc(late) * _window(late, kernel)
    spectrum = fft.rfft(interpolation) * response(np.arange(size + 1) / size)
    weights = 2.0 * fft.irfft(spectrum, 2 * size)[::2]
    lags = np.flatnonzero(np.abs(weights) > KERNEL_TOLERANCE * np.max(np.abs(weights)))
    lags = np.where(lags > size // 2, lags - size, lags)
    signal = fft.irfft(fft.rfft(np.where(valid, samples, 0.0), size) * fft.rfft(weights), size)[:n]
    return signal, _all_valid(valid, -int(np.max(lags)), -int(np.min(lags)))


def _window(distance: FloatArray, kernel: Kernel) -> FloatArray:
    """Return the window of the interpolation at distances in samples.

    Kaiser's jumps at its ends by 1/I0(β), which a third derivative enlarges at the far images of
    slow motion. A parabola takes the jump away.
    """
    half_width, beta = kernel
    inside = np.clip(1.0 - (distance / half_width) ** 2, 0.0, None)
    return np.asarray(inside * np.i0(beta * np.sqrt(inside)) / np.i0(beta))


def _all_valid(valid: BoolArray, begin: int, end: int) -> BoolArray:
    """Return for each sample k whether those from k + ``begin`` to k + ``end`` are all valid.

    Samples that do not exist are not.
    """
    bad = np.concatenate([[0], np.cumsum(~valid)])
    n = valid.shape[0]
    usable = np.zeros(n, dtype=bool)
    first = max(-begin, 0)
    last = max(min(n - end, n), first)
    usable[first:last] = bad[first + end + 1 : last + end + 1] == bad[first + begin : last + begin]
    return usable


def sampled_inputs(
    samples: FloatArray, valid: BoolArray, terms: int, delay_samples: float
) -> StepInputs:
    """Return inputs that are held between samples (terms = 1) or joined by straight lines (2)."""
    if terms == 1:
        coefficients = samples[:, None]
    else:
        following = np.append(samples[1:], samples[-1])
        coefficients = np.stack([0.5 * (samples + following), 0.5 * (following - samples)], axis=1)
    return _aligned(
        coefficients, math.ceil(delay_samples), sampled_filters(valid, terms, delay_samples)
    )


def sampled_filters(valid: BoolArray, terms: int, delay_samples: float) -> StepFilters:
    """Return the filters of :func:`sampled_inputs`."""
    lag = math.ceil(delay_samples)
    filters = np.ones((1, 1)) if terms == 1 else np.array([[0.5, 0.5], [-0.5, 0.5]])
    usable = valid if terms == 1 else valid & np.append(valid[1:], False)
    return StepFilters(filters, -lag, _delay_mask(usable, lag), lag - delay_samples)


def _delay_mask(usable: BoolArray, lag: int) -> BoolArray:
    """Return ``usable``, moved ``lag`` samples later."""
    moved = np.zeros_like(usable)
    n = usable.shape[0]
    if abs(lag) < n:
        moved[max(lag, 0) : n + min(lag, 0)] = usable[max(-lag, 0) : n - max(lag, 0)]
    return moved


def _aligned(coefficients: FloatArray, lag: int, filters: StepFilters) -> StepInputs:
    """Return the inputs moved ``lag`` samples later, so that step k meets response sample k."""
    last = len(coefficients) - 1
    source = np.clip(np.arange(last + 1) - lag, 0, last)
    return StepInputs(np.ascontiguousarray(coefficients[source]), filters.usable, filters.fraction)

"""The lines of a real signal's discrete Fourier transform."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.physics.discretisation.inputs import USABLE_BAND

#: Windows and transforms of filters are cached for signals of up to so many samples.
MAX_CACHED_SAMPLES = 1 << 16
#: Fewest samples of a spectrum.
MIN_SPECTRUM_SAMPLES = 256
#: Lines that are processed at once.
BLOCK_LINES = 1 << 13
#: Median of an exponential distribution over its mean.
MEDIAN_OF_POWER = float(np.log(2.0))


def line_frequencies(
    samples: int, sampling_rate_hz: float, lines: slice = slice(None)
) -> FloatArray:
    """Return the frequency of each line in Hz, shape (samples // 2 + 1,), or of those in a slice.

    The line at zero is given the frequency of the next: a reference in velocity has no response at
    zero, and an offset is fitted.
    """
    return np.maximum(np.arange(*lines.indices(samples // 2 + 1)), 1) * (sampling_rate_hz / samples)


def reference_colour(record: Record, samples: int) -> FloatArray | float:
    """Return the power of the reference's noise at each line over its mean; 1.0 where it is white.

    Args:
        record: with the order of its reference's noise.
        samples: of the transform, with lines of shape (samples // 2 + 1,).
    """
    order = record.reference_noise_order
    if order == 0:
        return 1.0
    return (order + 1.0) * (
        2.0 * np.maximum(np.arange(samples // 2 + 1), 1) / max(samples, 1)
    ) ** order


def transforms(signals: Sequence[FloatArray] | FloatArray) -> NDArray[np.complex128]:
    """Return the real transforms of signals of one length, shape (signals, samples // 2 + 1).

    Short signals are transformed together, which halves the time of each; long ones one by one,
    which saves memory.
    """
    if len(signals[0]) <= MAX_CACHED_SAMPLES:
        return np.asarray(fft.rfft(np.asarray(signals)), dtype=complex)
    spectra = np.empty((len(signals), len(signals[0]) // 2 + 1), dtype=complex)
    for row, signal in zip(spectra, signals, strict=True):
        row[:] = fft.rfft(signal)
    return spectra


def power_of(lines: NDArray[np.complex128]) -> FloatArray:
    """Return |line|², without the square roots that ``abs`` takes."""
    power = lines.real**2
    power += lines.imag**2
    return power


def in_blocks(lines: int) -> list[slice]:
    """Return blocks of so many lines that stay in the cache of the processor."""
    return [slice(begin, min(begin + BLOCK_LINES, lines)) for begin in range(0, lines, BLOCK_LINES)]


def about_mean(values: FloatArray, used: BoolArray) -> FloatArray:
    """Return values about the mean of the used ones, zero elsewhere, shape (samples,)."""
    if used.all():
        return values - values.mean()
    return np.where(used, values - (values[used].mean() if used.any() else 0.0), 0.0)


def band_sums(lines: NDArray[Any], edges: NDArray[np.int_]) -> NDArray[Any]:
    """Return the sums over bands of lines, shape (…, bands).

    Args:
        lines: shape (…, lines).
        edges: first line of each band, and the one after the last, shape (bands + 1,).
    """
    return np.add.reduceat(lines[..., : edges[-1]], edges[:-1], axis=-1)


def band_of(places: NDArray[Any], edges: NDArray[np.int_]) -> NDArray[np.int_]:
    """Return the number of the band that each place, in lines, belongs to.

    Places beyond the bands belong to the first and the last one.
    """
    return np.clip(np.searchsorted(edges, places, side="right") - 1, 0, len(edges) - 2)


def peak_shift(values: FloatArray, place: int) -> float:
    """Return the offset of the peak of a parabola through a maximum and its neighbours.

    Args:
        values: shape (n,).
        place: index of the maximum.

    Returns:
        In indices, from −0.5 to 0.5.
    """
    if not 0 < place < len(values) - 1:
        return 0.0
    before, top, after = values[place - 1 : place + 2]
    bend = 2.0 * top - before - after
    return float(np.clip(0.5 * (after - before) / bend, -0.5, 0.5)) if bend > 0.0 else 0.0


def log_peak_shift(lines: FloatArray, place: int, least: float) -> float:
    """Return the offset of the peak of a parabola through the logarithms of lines, in lines.

    Args:
        lines: sizes, shape (n,).
        place: index of a line with a neighbour on either side.
        least: lower limit of the sizes.
    """
    return peak_shift(np.log(np.maximum(lines[place - 1 : place + 2], least)), 1)


def line_counts(samples: int) -> FloatArray:
    """Return how often each line counts in a sum over the whole transform, shape (lines,).

    Lines with a conjugate count twice.
    """
    counts = np.full(samples // 2 + 1, 2.0)
    counts[0] = 1.0
    if samples % 2 == 0:
        counts[-1] = 1.0
    return counts


def counts_in_band(samples: int) -> FloatArray:
    """Return the line counts, zero outside of the usable band.

    That is at line 0, which holds the offset, and above the band of the interpolation.
    """
    counts = line_counts(samples)
    counts[:1] = 0.0
    counts[int(USABLE_BAND * samples) + 1 :] = 0.0
    return counts


def waves(places: Sequence[float] | FloatArray, samples: int) -> FloatArray:
    """Return cosines and sines of tones, and both growing with time, shape (4 tones, samples).

    Args:
        places: frequencies of the tones, in lines of the transform.
        samples: number of samples.
    """
    turn = np.arange(samples) / max(samples, 1)
    angle = 2.0 * np.pi * np.outer(np.asarray(places, dtype=float), turn)
    harmonics = np.concatenate([np.cos(angle), np.sin(angle)])
    return np.concatenate([harmonics, (turn - 0.5) * harmonics])


def median(values: FloatArray) -> Any:
    """Return ``np.median`` along the last axis, in a sixth of its time.

    NumPy selects two values at once, and looks for NaN, for which it loads masked arrays.
    """
    middle = values.shape[-1] // 2
    ordered = values.copy()
    ordered.partition(middle)
    high = ordered[..., middle]
    return high if values.shape[-1] % 2 else 0.5 * (np.max(ordered[..., :middle], axis=-1) + high)


def hann(samples: int) -> FloatArray:
    """Return the Hann window, shape (samples,), which is shared: do not write to it."""
    return (_cached_hann if samples <= MAX_CACHED_SAMPLES else _hann)(samples)


def _hann(samples: int) -> FloatArray:
    """Return ``np.hanning``, computed in place: of a long record each copy counts."""
    window = np.arange(1.0 - samples, samples, 2.0)
    window *= np.pi
    window /= max(samples - 1, 1)
    np.cos(window, out=window)
    window *= 0.5
    window += 0.5
    return window


_cached_hann = functools.lru_cache(maxsize=8)(_hann)

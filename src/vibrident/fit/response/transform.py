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

#: Windows and transforms of filters are kept for signals of up to so many samples.
MOST_KEPT = 1 << 16
#: Fewest samples for a spectrum.
SHORTEST = 256
#: Lines that are worked on at once.
AT_ONCE = 1 << 13
#: Of an exponential distribution, median over mean.
MEDIAN_OF_POWER = float(np.log(2.0))


def line_frequencies(
    samples: int, sampling_rate_hz: float, part: slice = slice(None)
) -> FloatArray:
    """Frequency of each line in Hz, shape (samples // 2 + 1,), or of some.

    The line at zero is given the next one's: a reference in velocity has no response at zero, and an offset is fitted.
    """
    return np.maximum(np.arange(*part.indices(samples // 2 + 1)), 1) * (sampling_rate_hz / samples)


def reference_colour(record: Record, samples: int) -> FloatArray | float:
    """Power of the reference's own noise over its mean, at the lines of so many samples; one where it is white."""
    order = record.reference_noise_order
    if order == 0:
        return 1.0
    return (order + 1.0) * (
        2.0 * np.maximum(np.arange(samples // 2 + 1), 1) / max(samples, 1)
    ) ** order


def transforms(signals: Sequence[FloatArray] | FloatArray) -> NDArray[np.complex128]:
    """Real transforms of signals of one length; of two or more side by side each takes half the time, but memory."""
    if len(signals[0]) <= MOST_KEPT:
        return np.asarray(fft.rfft(np.asarray(signals)), dtype=complex)
    found = np.empty((len(signals), len(signals[0]) // 2 + 1), dtype=complex)
    for row, signal in zip(found, signals, strict=True):
        row[:] = fft.rfft(signal)
    return found


def power_of(lines: NDArray[np.complex128]) -> FloatArray:
    """Squares of the magnitudes, without the roots that ``abs`` takes for them."""
    found = lines.real**2
    found += lines.imag**2
    return found


def in_blocks(lines: int) -> list[slice]:
    """Blocks of so many lines that stay in the processor's cache."""
    return [slice(begin, min(begin + AT_ONCE, lines)) for begin in range(0, lines, AT_ONCE)]


def about_mean(values: FloatArray, used: BoolArray) -> FloatArray:
    """Values about the mean of those that are used, zero where they are not, shape (samples,)."""
    if used.all():
        return values - values.mean()
    return np.where(used, values - (values[used].mean() if used.any() else 0.0), 0.0)


def line_counts(samples: int) -> FloatArray:
    """How often each line counts in a sum over the whole transform, shape (samples // 2 + 1,): its conjugate too."""
    counts = np.full(samples // 2 + 1, 2.0)
    counts[0] = 1.0
    if samples % 2 == 0:
        counts[-1] = 1.0
    return counts


def counts_in_band(samples: int) -> FloatArray:
    """Return these counts, zero at line 0, which holds the offset, and above the band of the interpolation."""
    counts = line_counts(samples)
    counts[:1] = 0.0
    counts[int(USABLE_BAND * samples) + 1 :] = 0.0
    return counts


def waves(places: Sequence[float] | FloatArray, samples: int) -> FloatArray:
    """Cosines and sines of these places, in lines, and both growing with time; shape (4 tones, samples)."""
    turn = np.arange(samples) / max(samples, 1)
    angle = 2.0 * np.pi * np.outer(np.asarray(places, dtype=float), turn)
    found = np.concatenate([np.cos(angle), np.sin(angle)])
    return np.concatenate([found, (turn - 0.5) * found])


def median(values: FloatArray) -> Any:
    """As ``np.median`` along the last axis, in a sixth of its time.

    That looks for two values at once, and for what is no number, for which it loads NumPy's masked arrays.
    """
    middle, ordered = values.shape[-1] // 2, values.copy()
    ordered.partition(middle)
    high = ordered[..., middle]
    return high if values.shape[-1] % 2 else 0.5 * (np.max(ordered[..., :middle], axis=-1) + high)


def hann(samples: int) -> FloatArray:
    """Hann window, shape (samples,); do not write to it."""
    return (_hann_kept if samples <= MOST_KEPT else _hann)(samples)


def _hann(samples: int) -> FloatArray:
    """As ``np.hanning``, in place: of a long record each copy counts."""
    window = np.arange(1.0 - samples, samples, 2.0)
    window *= np.pi
    window /= max(samples - 1, 1)
    np.cos(window, out=window)
    window *= 0.5
    window += 0.5
    return window


_hann_kept = functools.lru_cache(maxsize=8)(_hann)

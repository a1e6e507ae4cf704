"""Spectral lines beside a tone from which its noise is estimated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import span_of
from vibrident.fit.response.terms import Terms, TermTable
from vibrident.fit.response.transform import power_of

#: Noise lines lie at least this many bins from the tone …
GUARD_BINS = 3
#: … but no more than this fraction of its place, …
MAX_GUARD_FRACTION = 0.4
#: … within this factor of the tone's frequency, in these numbers.
BAND_FACTOR = 1.5
MIN_LINES = 48
MAX_LINES = 400
#: In records of at most this many samples a spectral line needs this fraction of its noise power
#: left by the fit to count as a noise line.
MAX_SHORT_SAMPLES = 4096
MIN_NOISE_FRACTION = 0.5


def noise_fraction(terms: Terms, mask: BoolArray) -> FloatArray:
    """Return the fraction of white noise that the fit leaves of each line, shape (lines,).

    In few periods, harmonics, offset and free response take nearly all of the lines beside the
    tone. In a long record they take the same of all.
    """
    count = float(mask.sum())
    if mask.size > MAX_SHORT_SAMPLES or not isinstance(terms, TermTable):
        return np.broadcast_to(max(count - len(terms.gram), 1.0) / count, mask.size // 2 + 1)
    design = np.zeros((len(terms.gram), mask.size))
    design[:, span_of(mask)] = terms.rows
    left_vectors, singular_values, _ = np.linalg.svd(design.T, full_matrices=False)
    basis = left_vectors[:, singular_values > 1e-5 * singular_values[0]].T
    fitted_fraction = np.sum(power_of(fft.rfft(basis, axis=1)), axis=0) / count
    return np.maximum(1.0 - fitted_fraction, 1e-3)


def noise_lines(
    n: int, frequency: float, rate: float, harmonics: int, fractions: Sequence[FloatArray]
) -> NDArray[np.int_]:
    """Return the numbers of the spectral lines that the tone's noise is estimated from.

    Args:
        n: number of samples.
        frequency: of the tone, Hz.
        rate: sampling rate, Hz.
        harmonics: number of harmonics that are fitted, the tone included.
        fractions: of white noise that the fit leaves of each line, for either channel of shape (n
            // 2 + 1,).

    Returns:
        Shape (K,), in order.
    """
    last = n // 2
    centre = frequency * n / rate
    # A window wide enough for the lines wanted, on whichever side there is room.
    reach = MIN_LINES + (2 * GUARD_BINS + 1) * harmonics
    low = max(1, min(int(centre / BAND_FACTOR), int(centre) - reach))
    high = min(last, max(int(centre * BAND_FACTOR) + 1, int(centre) + reach))
    bins = np.arange(low, max(high, low + 1))
    allowed = np.abs(bins - centre) >= min(GUARD_BINS, MAX_GUARD_FRACTION * centre)
    fraction = np.minimum(*(channel[bins] for channel in fractions))
    allowed &= fraction >= MIN_NOISE_FRACTION
    candidates = bins[allowed] if allowed.any() else bins[fraction >= np.sort(fraction)[-3:][0]]
    distance = np.abs(np.log(candidates / max(centre, 0.5)))
    order = np.argsort(distance, kind="stable")
    count = int(np.sum(distance <= np.log(BAND_FACTOR)))
    return np.sort(candidates[order[: int(np.clip(count, MIN_LINES, MAX_LINES))]])

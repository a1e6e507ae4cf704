"""The linear-phase anti-alias filter of a data-acquisition system, the same for both channels.

A shock has corners, hence content above half the sampling rate. Sampled without a filter, that content aliases; with it
the records are band-limited, like recorded ones. The same filter on both channels leaves the sensor's response to the
reference unchanged.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
from scipy import fft

from vibrident.measure.lines import fast_length
from vibrident.records import FloatArray

#: Ratio of the simulated rate to the sampling rate. For a corner's 1/f² spectrum, aliasing at the fine rate is smaller
#: by its square.
OVERSAMPLING = 64
PASS_BAND = 0.32  # edge of the pass band over the sampling rate
STOP_BAND = 0.42  # edge of the stop band over the sampling rate
DEPTH_DB = 160.0  # attenuation of the stop band, dB


@functools.cache
def _filter() -> FloatArray:
    """Kaiser-windowed sinc at the fine rate, odd length, sum one."""
    width = 2.0 * np.pi * (STOP_BAND - PASS_BAND) / OVERSAMPLING
    half = int(np.ceil((DEPTH_DB - 8.0) / (2.285 * width) / 2.0))
    n = np.arange(-half, half + 1)
    cut = (PASS_BAND + STOP_BAND) / OVERSAMPLING  # twice the band's middle, in cycles per fine sample
    taps = cut * np.sinc(cut * n) * np.kaiser(2 * half + 1, 0.1102 * (DEPTH_DB - 8.7))
    return taps / taps.sum()


def margin_samples() -> int:
    """Samples that the filter looks ahead, at the sampling rate."""
    return -(-(len(_filter()) // 2) // OVERSAMPLING)


def filtered(fine: Callable[[float, int], FloatArray], sampling_rate_hz: float, samples: int) -> FloatArray:
    """A channel sampled behind the filter; at rest before its first sample.

    ``fine``: from (sampling rate, number of samples) to the channel's values, from t = 0 on.
    """
    taps = _filter()
    half = len(taps) // 2
    count = (samples + margin_samples()) * OVERSAMPLING
    values = fine(sampling_rate_hz * OVERSAMPLING, count)
    size = fast_length(count + 2 * half)
    spectrum = np.asarray(fft.rfft(values, size)) * np.asarray(fft.rfft(taps, size))
    smooth = np.asarray(fft.irfft(spectrum, size))
    return smooth[half : half + samples * OVERSAMPLING : OVERSAMPLING].copy()

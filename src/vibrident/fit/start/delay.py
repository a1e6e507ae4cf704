"""The delay between the channels, estimated before any model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.averages import windowed
from vibrident.fit.problem.band import Band

#: A delay is searched at so many places a period of the highest frequency.
PER_PERIOD = 8
#: Of delays that differ by a factor of two, the longer must fit better by this fraction: a motion
#: that recurs fits as well a period later.
MIN_GAIN_PER_OCTAVE = 2e-3
#: Divisions of a bin to which frequencies of records of several lengths are rounded.
DIVISIONS = 8


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


def preferred(agreement: FloatArray, periods: FloatArray) -> FloatArray:
    """Return the agreement at delays, reduced by what a longer delay must gain.

    Args:
        agreement: shape (…, D).
        periods: the delays in periods, shape (D,).
    """
    return agreement * (1.0 - MIN_GAIN_PER_OCTAVE * np.log2(1.0 + np.abs(periods)))


def rough_delay(band: Band, heard: Mapping[int, BoolArray], high: float) -> float:
    """Return the delay at which the phases between the channels agree best, s.

    Amplitudes count for nothing, so a resonance does not hide the delay by its ringing; nor does a
    constant phase count. Exact to about the inverse of the width of the band.

    Args:
        band: the segments.
        heard: bins that count, by number of the segment.
        high: highest frequency of the motion, Hz.
    """
    longest = max(group.grid.samples / group.grid.rate_hz for group in band.groups)
    grids = {(group.grid.samples, group.grid.rate_hz) for group in band.groups}
    divisions = 1 if len(grids) == 1 else DIVISIONS
    spacing_hz = 1.0 / (divisions * longest)
    top_hz = max(group.grid.frequency_hz[-1] for group in band.groups)
    phases = np.zeros(int(top_hz / spacing_hz) + 2, complex)
    for group in band.groups:
        cross = windowed(group.response) * windowed(group.inputs[:, 0]).conj()
        cross *= np.stack([heard[number][1:-1] for number in group.segments])
        cross /= np.maximum(np.abs(cross), np.finfo(float).tiny)
        places = np.round(group.grid.frequency_hz[1:-1] / spacing_hz).astype(int)
        np.add.at(phases, places, np.sum(cross, axis=0))
    length = fast_length(2 * PER_PERIOD * len(phases))
    agreement = np.abs(fft.ifft(phases, length))
    delays_s = np.arange(length) / (length * spacing_hz)
    delays_s = np.where(delays_s > 0.5 / spacing_hz, delays_s - 1.0 / spacing_hz, delays_s)
    agreement = np.where(np.abs(delays_s) <= 0.5 * longest, agreement, 0.0)
    return float(delays_s[np.argmax(preferred(agreement, delays_s * high))])

"""The delay that records tell before any model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.group.band import Band
from vibrident.fit.noise.averages import windowed

#: A delay is looked for at so many places a period of the highest frequency.
PER_PERIOD = 8
#: Of delays that differ by a factor of two, the longer must fit better by this part: a record that
#: recurs fits as well a period later.
LONGER = 2e-3
#: Spacing of frequencies that bins of records of several lengths are brought to, a part of a bin.
FINE = 8


def beside_peak(values: FloatArray, place: int) -> float:
    """Return where a parabola through a maximum and its neighbours peaks, in places from it."""
    if not 0 < place < len(values) - 1:
        return 0.0
    before, here, after = values[place - 1 : place + 2]
    bend = 2.0 * here - before - after
    return float(np.clip(0.5 * (after - before) / bend, -0.5, 0.5)) if bend > 0.0 else 0.0


def preferred(agreement: FloatArray, periods: FloatArray) -> FloatArray:
    """Return the agreement at delays, in periods, less what a longer one must be better by."""
    return agreement * (1.0 - LONGER * np.log2(1.0 + np.abs(periods)))


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
    fine = 1 if len(grids) == 1 else FINE
    spacing_hz = 1.0 / (fine * longest)
    size = max(group.grid.frequency_hz[-1] for group in band.groups)
    phases = np.zeros(int(size / spacing_hz) + 2, complex)
    for group in band.groups:
        common = windowed(group.response) * windowed(group.inputs[:, 0]).conj()
        common *= np.stack([heard[number][1:-1] for number in group.segments])
        common /= np.maximum(np.abs(common), np.finfo(float).tiny)
        places = np.round(group.grid.frequency_hz[1:-1] / spacing_hz).astype(int)
        np.add.at(phases, places, np.sum(common, axis=0))
    length = fast_length(2 * PER_PERIOD * len(phases))
    agreement = np.abs(fft.ifft(phases, length))
    late = np.arange(length) / (length * spacing_hz)
    late = np.where(late > 0.5 / spacing_hz, late - 1.0 / spacing_hz, late)
    agreement = np.where(np.abs(late) <= 0.5 * longest, agreement, 0.0)
    return float(late[np.argmax(preferred(agreement, late * high))])

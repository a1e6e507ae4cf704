"""The delay at which the phases between two channels agree.

A sensor's phase is nearly constant in an octave, below its resonance and above it, so the phases
agree at the delay in each octave, up to a constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.data.records import FloatArray
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A delay is searched at so many places a period of the highest frequency.
PER_PERIOD = 8
#: Of delays that differ by a factor of two, the longer must fit better by this fraction: a motion
#: that recurs fits as well a period later.
MIN_GAIN_PER_OCTAVE = 2e-3
#: Cells of frequency in a bin. Each phase is shared among two cells.
CELLS_PER_BIN = 2
#: Bins from the middle of the main lobe of a Hann window to its end.
LOBE_BINS = 2.0


class Phases(NamedTuple):
    """Phases between two channels at N bins.

    Attributes:
        frequency_hz: of the motion within each bin, shape (N,).
        phase: of the response less that of the reference, as a factor, shape (N,).
        power: of the reference, shape (N,).
    """

    frequency_hz: FloatArray
    phase: ComplexArray
    power: FloatArray

    @classmethod
    def between(
        cls,
        reference: tuple[ComplexArray, ComplexArray],
        response: ComplexArray,
        frequency_hz: FloatArray,
        bin_hz: float,
    ) -> Phases:
        """Return the phases at bins under a Hann window.

        Their frequency is that of the motion within the bin, by the rate of the reference's phase
        as the window moves (Auger & Flandrin, *IEEE Trans. Signal Process.* 43, 1995). It is exact
        of a tone.

        Args:
            reference: its bins under the window, and half the difference of the bins before and
                after each without it, both in one scale and of shape (N,).
            response: its bins under the window, shape (N,).
            frequency_hz: of the bins, shape (N,).
            bin_hz: their distance.
        """
        motion, rate = reference
        cross = response * motion.conj()
        nonzero = cross != 0.0
        offset = (0.5 * rate[nonzero] / motion[nonzero]).real
        offset = np.clip(offset, -LOBE_BINS, LOBE_BINS)
        return cls(
            np.maximum(frequency_hz[nonzero] + bin_hz * offset, 0.0),
            cross[nonzero] / np.abs(cross[nonzero]),
            power_of(motion[nonzero]),
        )


def preferred(agreement: FloatArray, periods: FloatArray) -> FloatArray:
    """Return the agreement at delays, reduced by what a longer delay must gain.

    Args:
        agreement: shape (…, D).
        periods: the delays in periods, shape (D,).
    """
    return agreement * (1.0 - MIN_GAIN_PER_OCTAVE * np.log2(1.0 + np.abs(periods)))


def agreed_delay(phases: Phases, longest_s: float, high_hz: float) -> float:
    """Return the delay at which phases agree best, at most half the longest record, s.

    The response's amplitude counts for nothing, so a resonance does not hide the delay by its
    ringing. Each bin counts by the reference's power within its octave: between tones there is no
    motion. Exact to about the inverse of the width of the band.

    Args:
        phases: between the channels.
        longest_s: duration of the longest record.
        high_hz: highest frequency of the motion.
    """
    if not phases.phase.size:
        return 0.0
    cell_hz = 1.0 / (CELLS_PER_BIN * longest_s)
    place = phases.frequency_hz / cell_hz
    length = 2 ** int(np.ceil(np.log2(PER_PERIOD * (np.max(place) + 2.0))))
    agreement = _agreement(phases, place, length)
    turns = np.arange(length) / length
    turns = np.where(turns > 0.5, turns - 1.0, turns)
    agreement /= np.sinc(turns) ** 2  # phases shared among two cells agree less at longer delays
    delays_s = turns / cell_hz
    agreement = np.where(np.abs(delays_s) <= 0.5 * longest_s, agreement, 0.0)
    return float(delays_s[np.argmax(preferred(agreement, delays_s * high_hz))])


def _agreement(phases: Phases, place: FloatArray, length: int) -> FloatArray:
    """Return the agreement of phases at delays, summed over octaves from the highest frequency.

    An octave counts by the number of its bins that share its power.

    Args:
        phases: N phases.
        place: frequencies in cells, shape (N,).
        length: number of delays, a power of two.

    Returns:
        At delays n / length of the inverse of a cell, shape (length,).
    """
    cell = place.astype(int)
    top = int(np.max(cell)) + 1
    octave = np.floor(np.log2(top / np.maximum(cell, 1))).astype(int)
    agreement = np.zeros(1)
    for number in range(int(np.max(octave)), -1, -1):
        within = np.flatnonzero(octave == number)
        power = phases.power[within]
        squares = float(np.sum(power**2))
        weight = power * (np.sum(power) / squares if squares > 0.0 else 0.0)
        weighted = weight * phases.phase[within]
        upper = place[within] - cell[within]
        first = cell[within] - (top >> (number + 1))
        delays = length >> number
        sums = np.zeros(delays, complex)
        np.add.at(sums, first, (1.0 - upper) * weighted)
        np.add.at(sums, first + 1, upper * weighted)
        # Delays of lower octaves are further apart: those between follow along a line.
        coarse = np.append(agreement, agreement[0])
        steps = np.arange(delays) * (len(agreement) / delays)
        agreement = np.interp(steps, np.arange(len(coarse)), coarse)
        agreement += np.abs(fft.ifft(sums)) * delays
    return agreement

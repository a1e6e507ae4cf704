"""The displacement and the response at the same instants.

The acceleration is made of second differences and a filter that makes them derivatives, within a
band. A shock or a sweep ends elsewhere than it began, often still moving: its displacement is a
ramp, which spoils a spectrum; its acceleration is not. The second difference has the response (2
sin ½ω)² exactly; the filter beside it has (½ω / sin ½ω)², to 5e-6 up to 0.35 of the sampling rate,
to 1e-3 up to 0.4, and zero at half.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy import fft

from vibrident.base.errors import InputError
from vibrident.data.interferometer.decimation import (
    ATTENUATION_DB,
    BETA,
    PASS,
    at_positions,
    decimated,
    lost_at_an_end,
    reach,
)
from vibrident.data.interferometer.demodulation import Demodulated
from vibrident.data.interferometer.setting import BoolArray, FloatArray, Signals
from vibrident.data.interferometer.survey import BLOCK

#: Half the filter's length, by Kaiser's formula for a transition from 0.4 to 0.5 of the rate.
HALF_FILTER = int(np.ceil(0.5 * (ATTENUATION_DB - 7.95) / (2.285 * 2.0 * np.pi * 0.1)))
LOST = HALF_FILTER + 1  # samples lost at either end
OF_SINE = 16.0, 1 << 14  # fewest samples that are kept of a period of a sine, and of a record of it
# fewest of a period of the highest frequency of other motion, and of a record of it …
OF_OTHERS = (
    6.0,
    1 << 10,
)
# … and where light is lost: filters for a lower rate reach further over a pulse
BESIDE_GAPS = (
    48.0,
    1 << 17,
)
FINER = 2.5  # fewest samples of the displacement for each of a slower response


@functools.cache
def _derivative_filter() -> FloatArray:
    """Return the filter's coefficients, shape (2 · HALF_FILTER + 1,), symmetric."""
    points = 1 << 14
    frequency = np.arange(points // 2 + 1) / points  # of the rate
    half = np.pi * frequency
    wanted = np.divide(half, np.sin(half), out=np.ones(half.shape), where=half > 0.0) ** 2
    inside = frequency <= 0.5 * (PASS + 0.5)
    window = np.kaiser(2 * HALF_FILTER + 1, BETA)
    asked = wanted.copy()
    for _ in range(8):  # the window smooths the target, so the target is raised where it is curved
        impulse = (
            np.roll(np.fft.irfft(asked * inside, points), HALF_FILTER)[: 2 * HALF_FILTER + 1]
            * window
        )
        given = np.real(
            np.fft.rfft(np.roll(np.pad(impulse, (0, points - impulse.size)), -HALF_FILTER))
        )
        asked += np.where(frequency <= PASS, wanted - given, 0.0)
    return np.asarray(impulse)


def accelerated(
    displacement: FloatArray, valid: BoolArray, rate_hz: float
) -> tuple[FloatArray, BoolArray]:
    """Return the acceleration and its validity, both ``LOST`` samples shorter at either end.

    ``displacement``: shape (n,), m; ``valid``: shape (n,).
    """
    second = np.diff(displacement, 2) * rate_hz**2
    bad = np.convolve(~valid, np.ones(2 * LOST + 1), "valid") > 0.5
    return np.convolve(second, _derivative_filter(), "valid"), ~bad


@dataclass(frozen=True, eq=False)
class Aligned:
    """Both channels, all of shape (n,); ``start_s`` is the time of the first sample since the record's begin."""

    displacement_m: FloatArray
    response: FloatArray
    valid: BoolArray
    rate_hz: float
    start_s: float

    @property
    def accelerated(self) -> Aligned:
        """Return the same with the acceleration, m/s², in place of the displacement."""
        values, valid = accelerated(self.displacement_m, self.valid, self.rate_hz)
        response = self.response[LOST : self.response.shape[0] - LOST]
        return _whole(values, response, valid, self.rate_hz, self.start_s + LOST / self.rate_hz)


def thinning(samples: int, rate_hz: float, highest_hz: float, kept: tuple[float, int]) -> int:
    """Return the factor by which a response is decimated.

    ``samples``: of it; ``highest_hz``: frequency of a sine, or the highest that stands above the
    noise; ``kept``: fewest samples of a period of it and of the record: a sine has harmonics, other
    motion only noise above.
    """
    per_period, fewest = kept
    return max(min(int(rate_hz / (per_period * highest_hz)), samples // fewest), 1)


def no_finer(response_hz: float, optical_hz: float) -> int:
    """Return the factor by which a response is decimated at least, so that it is no finer than the displacement.

    Between the samples of a displacement there is no noise: interpolated, its noise would end below
    half the rate, and whatever takes it for white would take too little for it.
    """
    return max(int(np.ceil(response_hz / optical_hz * (1.0 - 1e-9))), 1)


def finer(rate_hz: float, response_hz: float) -> int:
    """Return the factor from optical samples to the displacement's, for a response of another rate."""
    return max(int(rate_hz / (FINER * response_hz)), 1)


def together(
    found: Demodulated, optical: Signals, response: Signals, every: int, delay_s: float
) -> Aligned:
    """Return the displacement and response at the same instants.

    If both are recorded together they pass the same filter, whose response cancels.

    ``found``: the displacement; ``optical``: the signals it was made from; ``response``: one
    signal, its first sample at time zero; ``every``: decimation of the response; ``delay_s``: the
    optical channel comes later by this.
    """
    blocks = (
        response.block(s, min(s + BLOCK, response.samples))
        for s in range(0, response.samples, BLOCK)
    )
    values = decimated(
        (block[0].astype(float, copy=False) for block in blocks), response.samples, every
    )
    rate = response.rate_hz / every
    first = lost_at_an_end(every) / response.rate_hz
    time = first + np.arange(values.shape[0]) / rate
    wanted = ((time + delay_s - optical.first_s) * optical.rate_hz - found.first) / found.factor
    spacing = optical.rate_hz / found.factor / rate
    count = min(values.shape[0], found.displacement_m.shape[0])
    if abs(spacing - 1.0) < 1e-9 and abs(float(wanted[0])) < 1e-6:
        return _whole(
            found.displacement_m[:count], values[:count], found.valid[:count], rate, first
        )
    kept, displacement, valid = _moved(found.displacement_m, found.valid, wanted, spacing)
    return _whole(displacement, values[kept], valid, rate, first + kept.start / rate)


def _moved(
    values: FloatArray, valid: BoolArray, wanted: FloatArray, spacing: float
) -> tuple[slice, FloatArray, BoolArray]:
    """Return the displacement at positions, in its samples: the covered positions, the values, and their validity."""
    spacing, half = max(spacing, 1.0), reach(max(spacing, 1.0))
    inside = np.flatnonzero((wanted >= half) & (wanted <= values.shape[0] - 1 - half))
    kept = slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)
    at = wanted[kept]
    bad = np.concatenate([[0], np.cumsum(~valid)])
    low = np.floor(at).astype(int) - half
    high = np.floor(at).astype(int) + half + 2
    sound = bad[np.minimum(high, valid.shape[0])] == bad[np.maximum(low, 0)]
    return kept, at_positions(values, at, spacing) if at.size else np.zeros(0), sound


def _whole(
    displacement: FloatArray, values: FloatArray, valid: BoolArray, rate: float, start: float
) -> Aligned:
    if displacement.shape[0] < 8 or not valid.any():
        raise InputError(
            "Too little of the record is left beside the ends of the filters.",
            expected="records of some hundred samples of the slower channel, and channels that cover the same time",
            found=f"{displacement.shape[0]} samples",
            where="[interferometer]",
            remedy="record for longer, or check rate_hz and delay_s",
        )
    # a few samples less, and every transform is quick
    count = fft.prev_fast_len(displacement.shape[0]) or displacement.shape[0]
    return Aligned(displacement[:count], values[:count], valid[:count], rate, start)

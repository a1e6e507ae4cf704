"""Bring displacement and response to the same instants, and differentiate the displacement.

The acceleration is the second difference, corrected by a filter to the second derivative within a
band. A shock or a sweep ends elsewhere than it began, often still moving: its displacement is a
ramp, which spoils a spectrum; its acceleration is not. The second difference has the response (2
sin ½ω)² exactly; the filter has (½ω / sin ½ω)², to 5e-6 up to 0.35 of the sampling rate, to 1e-3 up
to 0.4, and zero at half.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy import fft

from vibrident.base.errors import InputError
from vibrident.data.interferometer.decimation import (
    ATTENUATION_DB,
    KAISER_BETA,
    PASS_EDGE,
    at_positions,
    decimated,
    lost_at_an_end,
    reach,
)
from vibrident.data.interferometer.demodulation import Demodulated
from vibrident.data.interferometer.setting import BoolArray, FloatArray, SampledSignals
from vibrident.data.interferometer.survey import BLOCK_SAMPLES

#: Half the filter's length, by Kaiser's formula for a transition from 0.4 to 0.5 of the rate.
HALF_FILTER = int(np.ceil(0.5 * (ATTENUATION_DB - 7.95) / (2.285 * 2.0 * np.pi * 0.1)))
LOST_SAMPLES = HALF_FILTER + 1  # samples lost at either end
# fewest samples that are kept of a period of a sine, and of a record of it
MIN_SAMPLES_OF_SINE = (16.0, 1 << 14)
# fewest of a period of the highest frequency of other motion, and of a record of it …
MIN_SAMPLES_OF_OTHERS = (6.0, 1 << 10)
# … and where light is lost: filters for a lower rate reach further over a pulse
MIN_SAMPLES_BESIDE_GAPS = (48.0, 1 << 17)
MIN_RATE_RATIO = 2.5  # fewest samples of the displacement for each of a slower response


@functools.cache
def _derivative_filter() -> FloatArray:
    """Return the filter's coefficients, shape (2 · HALF_FILTER + 1,), symmetric."""
    points = 1 << 14
    frequency = np.arange(points // 2 + 1) / points  # of the rate
    half = np.pi * frequency
    target = np.divide(half, np.sin(half), out=np.ones(half.shape), where=half > 0.0) ** 2
    inside = frequency <= 0.5 * (PASS_EDGE + 0.5)
    window = np.kaiser(2 * HALF_FILTER + 1, KAISER_BETA)
    raised_target = target.copy()
    for _ in range(8):  # the window smooths the target, so the target is raised where it is curved
        impulse = (
            np.roll(np.fft.irfft(raised_target * inside, points), HALF_FILTER)[
                : 2 * HALF_FILTER + 1
            ]
            * window
        )
        response = np.real(
            np.fft.rfft(np.roll(np.pad(impulse, (0, points - impulse.size)), -HALF_FILTER))
        )
        raised_target += np.where(frequency <= PASS_EDGE, target - response, 0.0)
    return np.asarray(impulse)


def differentiated(
    displacement: FloatArray, valid: BoolArray, rate_hz: float
) -> tuple[FloatArray, BoolArray]:
    """Return the acceleration and its validity, both ``LOST_SAMPLES`` shorter at either end.

    Args:
        displacement: m, shape (n,).
        valid: shape (n,).
        rate_hz: sampling rate.
    """
    second = np.diff(displacement, 2) * rate_hz**2
    bad = np.convolve(~valid, np.ones(2 * LOST_SAMPLES + 1), "valid") > 0.5
    return np.convolve(second, _derivative_filter(), "valid"), ~bad


@dataclass(frozen=True, eq=False)
class AlignedDisplacement:
    """Displacement and response at the same instants, all of shape (n,).

    ``start_s``: time of the first sample since the begin of the record.
    """

    displacement_m: FloatArray
    response: FloatArray
    valid: BoolArray
    rate_hz: float
    start_s: float

    @property
    def accelerated(self) -> AlignedDisplacement:
        """Return both channels with the acceleration, m/s², in place of the displacement."""
        values, valid = differentiated(self.displacement_m, self.valid, self.rate_hz)
        response = self.response[LOST_SAMPLES : self.response.shape[0] - LOST_SAMPLES]
        return _aligned(
            values, response, valid, self.rate_hz, self.start_s + LOST_SAMPLES / self.rate_hz
        )


def thinning_factor(
    samples: int, rate_hz: float, highest_hz: float, minima: tuple[float, int]
) -> int:
    """Return the factor by which a response is decimated.

    Args:
        samples: of the response.
        rate_hz: of the response.
        highest_hz: frequency of a sine, or the highest that stands above the noise.
        minima: fewest samples of a period and of the record: a sine has harmonics, other motion has
            only noise above.
    """
    per_period, fewest = minima
    return max(min(int(rate_hz / (per_period * highest_hz)), samples // fewest), 1)


def min_thinning_factor(response_hz: float, optical_hz: float) -> int:
    """Return the smallest factor that leaves a response no finer than the displacement.

    There is no noise between the samples of a displacement: interpolated, its noise would end below
    half the rate, and an estimate for white noise would be too small.
    """
    return max(int(np.ceil(response_hz / optical_hz * (1.0 - 1e-9))), 1)


def optical_factor(rate_hz: float, response_hz: float) -> int:
    """Return the decimation of optical samples that suits a response of another rate."""
    return max(int(rate_hz / (MIN_RATE_RATIO * response_hz)), 1)


def aligned_channels(
    demodulated: Demodulated,
    optical: SampledSignals,
    response: SampledSignals,
    every: int,
    delay_s: float,
) -> AlignedDisplacement:
    """Return the displacement and the response at the same instants.

    If both are recorded together they pass the same filter, whose response cancels.

    Args:
        demodulated: the displacement.
        optical: the signals that it was made from.
        response: one signal, its first sample at time zero.
        every: decimation of the response.
        delay_s: delay of the optical channel.
    """
    blocks = (
        response.block(s, min(s + BLOCK_SAMPLES, response.samples))
        for s in range(0, response.samples, BLOCK_SAMPLES)
    )
    values = decimated(
        (block[0].astype(float, copy=False) for block in blocks), response.samples, every
    )
    rate = response.rate_hz / every
    first = lost_at_an_end(every) / response.rate_hz
    time = first + np.arange(values.shape[0]) / rate
    positions = (
        (time + delay_s - optical.first_s) * optical.rate_hz - demodulated.first
    ) / demodulated.factor
    spacing = optical.rate_hz / demodulated.factor / rate
    displacement = demodulated.displacement_m
    valid = demodulated.valid
    covered = slice(0, min(values.shape[0], displacement.shape[0]))
    if abs(spacing - 1.0) < 1e-9 and abs(float(positions[0])) < 1e-6:
        displacement = displacement[covered]
        valid = valid[covered]
    else:
        covered, displacement, valid = _displacement_at(displacement, valid, positions, spacing)
    return _aligned(displacement, values[covered], valid, rate, first + covered.start / rate)


def _displacement_at(
    values: FloatArray, valid: BoolArray, positions: FloatArray, spacing: float
) -> tuple[slice, FloatArray, BoolArray]:
    """Return the covered positions, the displacement at them, and its validity.

    ``positions`` and ``spacing``: in samples of the displacement.
    """
    spacing = max(spacing, 1.0)
    half = reach(spacing)
    inside = np.flatnonzero((positions >= half) & (positions <= values.shape[0] - 1 - half))
    covered = slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, 0)
    at = positions[covered]
    bad = np.concatenate([[0], np.cumsum(~valid)])
    low = np.floor(at).astype(int) - half
    high = np.floor(at).astype(int) + half + 2
    intact = bad[np.minimum(high, valid.shape[0])] == bad[np.maximum(low, 0)]
    return covered, at_positions(values, at, spacing) if at.size else np.zeros(0), intact


def _aligned(
    displacement: FloatArray, values: FloatArray, valid: BoolArray, rate: float, start: float
) -> AlignedDisplacement:
    if displacement.shape[0] < 8 or not valid.any():
        raise InputError(
            "Too little of the record is left beside the ends of the filters.",
            expected="records of some hundred samples of the slower channel, and channels that "
            "cover the same time",
            found=f"{displacement.shape[0]} samples",
            where="[interferometer]",
            remedy="record for longer, or check rate_hz and delay_s",
        )
    # Some samples are dropped for a length with a fast transform.
    count = fft.prev_fast_len(displacement.shape[0]) or displacement.shape[0]
    return AlignedDisplacement(displacement[:count], values[:count], valid[:count], rate, start)

"""Mix a heterodyne signal down from its carrier to two signals in quadrature at a lower rate.

One kernel mixes and filters: the product of the filter's coefficients and the carrier. The error of
the estimated carrier remains as a slope of the phase.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.interferometer.decimation import HALF, PASS_EDGE, at_lower_rate, filtered, taps
from vibrident.data.interferometer.setting import FloatArray, SampledSignals

#: Samples of each of the blocks in which the carrier is searched, and their number.
PIECE_SAMPLES = 8192
PIECES = 48
#: Smallest power of the carrier's band over that of the largest line.
MIN_TO_LARGEST = 1e-4
#: Smallest power of the carrier's band over the floor.
MIN_TO_FLOOR = 45.0
#: Quantile of the spectrum that is the floor: a wide band fills most of the spectrum.
FLOOR_QUANTILE = 0.05
#: Smallest band that is kept over the width of the carrier's band.
MIN_BAND_RATIO = 1.6
#: The same where noise permits: a cyclic error of order 4 has sidebands five times as wide.
FULL_BAND_RATIO = 5.0
#: Largest phase noise with which noise permits it.
MAX_PHASE_NOISE_RAD = 0.1
#: Smallest band on either side over the response's rate: enough for a cyclic error of fast sines.
MIN_BAND_TO_RESPONSE_RATE = 0.8
#: Upper limit of that smallest band, over the rate of the signal.
MAX_LEAST_BAND = 1.0 / 32.0
#: The same for a shock: short filters keep its pulse apart from the ends of a record.
MAX_LEAST_BAND_OF_SHOCK = 1.0 / 8.0
#: Usable share of the room on either side of the carrier.
USABLE_ROOM = 0.8


def mix_down(
    raw: SampledSignals, near_hz: float, response_hz: float, where: str, max_band: float
) -> tuple[SampledSignals, float]:
    """Mix a heterodyne signal down to two signals in quadrature; return these and its carrier, Hz.

    Args:
        raw: one signal.
        near_hz: its carrier, approximately.
        response_hz: sampling rate of the sensor's response.
        where: place in the calibration file, for messages.
        max_band: largest value of the least band on either side, over the signal's rate.

    Raises:
        InputError: no carrier is found, or the band beside it is too narrow.
    """
    half_rate_hz = 0.5 * raw.rate_hz
    if not 0 < near_hz < half_rate_hz:
        raise InputError(
            "The carrier lies above half the sampling rate.",
            expected=f"carrier_hz below {half_rate_hz:.9g} Hz, half the rate of the signal",
            found=f"carrier_hz = {near_hz!r}",
            where=f"{where}, [interferometer] carrier_hz",
            remedy="correct carrier_hz, or rate_hz of [interferometer]",
        )
    room_hz = USABLE_ROOM * min(near_hz, half_rate_hz - near_hz)
    length = min(PIECE_SAMPLES, raw.samples)
    starts = np.linspace(0, raw.samples - length, PIECES).astype(int)
    blocks = np.stack([raw.block(int(s), int(s) + length)[0] for s in starts], dtype=float)
    moving = blocks - blocks.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(moving * np.blackman(length))) ** 2
    low_hz, high_hz = _carrier_band_hz(np.max(power, axis=0), raw.rate_hz, near_hz, room_hz, where)
    width_hz = high_hz - low_hz
    least_hz = max(
        16.0 * raw.rate_hz / PIECE_SAMPLES,
        min(MIN_BAND_TO_RESPONSE_RATE * response_hz, max_band * raw.rate_hz),
    )
    clear_hz = _clear_band_hz(np.mean(power, axis=0), half_rate_hz)
    full_hz = min(0.5 * FULL_BAND_RATIO * width_hz, clear_hz)
    band_hz = min(max(0.5 * MIN_BAND_RATIO * width_hz, full_hz, least_hz), room_hz)
    middle_hz = 0.5 * (low_hz + high_hz)
    carrier_hz = float(np.clip(middle_hz, near_hz - 0.5 * room_hz, near_hz + 0.5 * room_hz))
    band_hz = min(band_hz, USABLE_ROOM * min(carrier_hz, half_rate_hz - carrier_hz))
    max_factor = max(raw.samples // (8 * HALF), 2)
    factor = int(np.clip(PASS_EDGE * raw.rate_hz / band_hz, 2, max_factor))
    cycles = carrier_hz / raw.rate_hz
    kernel = 2.0 * taps(factor) * np.exp(-2j * np.pi * cycles * np.arange(2 * HALF * factor + 1))
    # The filter lets part of the offset pass where the carrier's band is wide.
    offset = float(blocks.mean()) * kernel.sum()

    def block(start: int, stop: int) -> FloatArray:
        mixed = filtered(raw, (1, stop - start), factor, kernel, start)[0] - offset
        turns = np.mod(cycles * factor * np.arange(start, stop), 1.0)
        return _real_and_imaginary(mixed * np.exp(-2j * np.pi * turns))

    return at_lower_rate(raw, factor, block), carrier_hz


def without_residual_carrier(
    raw: SampledSignals, residual: np.polynomial.Legendre
) -> SampledSignals:
    """Return two signals in quadrature whose phase has no residual carrier, only the motion.

    ``residual``: phase of the residual carrier, rad, as a function of the index of a sample.
    """

    def block(start: int, stop: int) -> FloatArray:
        u = raw.block(start, stop)
        return _real_and_imaginary(
            (u[0] + 1j * u[1]) * np.exp(-1j * residual(np.arange(start, stop)))
        )

    return replace(raw, block=block)


def _real_and_imaginary(values: np.ndarray) -> FloatArray:
    return np.stack([np.real(values), np.imag(values)])


def _clear_band_hz(power: FloatArray, half_hz: float) -> float:
    """Return the band on either side of the carrier with the largest allowed phase noise, Hz."""
    noise = max(float(np.quantile(power, FLOOR_QUANTILE)), 1e-300)
    return (
        MAX_PHASE_NOISE_RAD**2
        * max(float(np.sum(power)) / noise - power.shape[0], 0.0)
        * half_hz
        / power.shape[0]
    )


def _carrier_band_hz(
    power: FloatArray, rate_hz: float, near_hz: float, room: float, where: str
) -> tuple[float, float]:
    """Return the lowest and highest frequency of the carrier's band, Hz."""
    lines = np.linspace(0.0, 0.5 * rate_hz, power.shape[0])
    inside = np.abs(lines - near_hz) <= room
    floor = float(np.quantile(power, FLOOR_QUANTILE))
    strong = inside & (
        power > max(MIN_TO_LARGEST * float(power[inside].max(initial=0.0)), MIN_TO_FLOOR * floor)
    )
    if not strong.any():
        raise InputError(
            "No carrier was found.",
            expected=f"a line near carrier_hz = {near_hz!r}",
            found="nothing above the noise there",
            where=f"{where}, [interferometer] carrier_hz",
            remedy="correct carrier_hz, rate_hz of [interferometer], or the column",
        )
    return float(lines[strong].min()), float(lines[strong].max())

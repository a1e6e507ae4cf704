"""A heterodyne signal mixed down from its carrier: two signals in quadrature at a lower rate.

Mixing and filtering are one product: the filter's coefficients times those of the carrier. The
error of the estimated carrier remains as a slope of the phase.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.interferometer.decimation import HALF, PASS, at_lower_rate, filtered, taps
from vibrident.data.interferometer.setting import FloatArray, Signals

PIECE = 8192  # samples of each of 48 pieces in which the carrier is searched
PART = 1e-4  # the carrier's band is above this part of the largest line
FLOOR = 45.0  # it is also above this multiple of the floor …
QUIET = 0.05  # … which is this quantile of the spectrum: a wide band fills most of it
MARGIN = 1.6  # band kept over the width of the carrier's band, at least …
WHOLE = 5.0  # … and so much: a cyclic error of order 4 has sidebands five times as wide …
CLEAR = 0.1  # … where the noise of the phase, rad, stays below this
# least band, on either side, over the response's rate: enough for a cyclic error of fast sines …
LEAST = 0.8
MOST_OF_ALL = 1.0 / 32.0  # … but over that of the signal at most this …
# … and for a shock, whose pulse short filters keep apart from the ends of a record, this
MOST_OF_SHOCK = 1.0 / 8.0
ROOM = 0.8  # usable part of the room beside the carrier


def mixed_down(
    raw: Signals, near_hz: float, response_hz: float, where: str, most: float
) -> tuple[Signals, float]:
    """Return a heterodyne signal mixed down to two signals in quadrature, and its carrier, Hz, found near a frequency.

    ``raw``: one signal; ``near_hz``: its carrier, approximately; ``response_hz``: sampling rate of
    the sensor's response; ``most``: of the signal's rate that the least band may take on either
    side.

    Raises:
        InputError: no carrier is found, or the band beside it is too narrow.
    """
    half = 0.5 * raw.rate_hz
    if not 0 < near_hz < half:
        raise InputError(
            "The carrier lies above half the sampling rate.",
            expected=f"carrier_hz below {half:.9g} Hz, half the sampling rate of the signal",
            found=f"carrier_hz = {near_hz!r}",
            where=f"{where}, [interferometer] carrier_hz",
            remedy="correct carrier_hz, or rate_hz of [interferometer]",
        )
    room = ROOM * min(near_hz, half - near_hz)
    length = min(PIECE, raw.samples)
    starts = np.linspace(0, raw.samples - length, 48).astype(int)
    pieces = np.stack([raw.block(int(s), int(s) + length)[0] for s in starts], dtype=float)
    power = (
        np.abs(
            np.fft.rfft(
                (pieces - pieces.mean(axis=1, keepdims=True)) * np.blackman(pieces.shape[1])
            )
        )
        ** 2
    )
    low, high = _band(np.max(power, axis=0), raw.rate_hz, near_hz, room, where)
    least = max(16.0 * raw.rate_hz / PIECE, min(LEAST * response_hz, most * raw.rate_hz))
    whole = min(0.5 * WHOLE * (high - low), _clear(np.mean(power, axis=0), half))
    wide = min(max(0.5 * MARGIN * (high - low), whole, least), room)
    carrier_hz = float(np.clip(0.5 * (low + high), near_hz - 0.5 * room, near_hz + 0.5 * room))
    wide = min(wide, ROOM * min(carrier_hz, half - carrier_hz))
    factor = int(np.clip(PASS * raw.rate_hz / wide, 2, max(raw.samples // (8 * HALF), 2)))
    cycles = carrier_hz / raw.rate_hz
    kernel = 2.0 * taps(factor) * np.exp(-2j * np.pi * cycles * np.arange(2 * HALF * factor + 1))
    # the filter lets it pass in part where the carrier's band is wide
    offset = float(pieces.mean()) * kernel.sum()

    def block(start: int, stop: int) -> FloatArray:
        mixed = filtered(raw, (1, stop - start), factor, kernel, start)[0] - offset
        return _parts(
            mixed * np.exp(-2j * np.pi * np.mod(cycles * factor * np.arange(start, stop), 1.0))
        )

    return at_lower_rate(raw, factor, block), carrier_hz


def turned_back(raw: Signals, left: np.polynomial.Legendre) -> Signals:
    """Return two signals in quadrature without what is left of their carrier: their phase is the motion's alone.

    ``left``: phase of the carrier that is left, rad, over the index of a sample.
    """

    def block(start: int, stop: int) -> FloatArray:
        u = raw.block(start, stop)
        return _parts((u[0] + 1j * u[1]) * np.exp(-1j * left(np.arange(start, stop))))

    return replace(raw, block=block)


def _parts(values: np.ndarray) -> FloatArray:
    return np.stack([np.real(values), np.imag(values)])


def _clear(power: FloatArray, half_hz: float) -> float:
    """Return the band on either side of the carrier with a noise of the phase of ``CLEAR``, Hz."""
    noise = max(float(np.quantile(power, QUIET)), 1e-300)
    return (
        CLEAR**2
        * max(float(np.sum(power)) / noise - power.shape[0], 0.0)
        * half_hz
        / power.shape[0]
    )


def _band(
    power: FloatArray, rate_hz: float, near_hz: float, room: float, where: str
) -> tuple[float, float]:
    """Return the lowest and highest frequency of the carrier's band."""
    lines = np.linspace(0.0, 0.5 * rate_hz, power.shape[0])
    inside = np.abs(lines - near_hz) <= room
    floor = float(np.quantile(power, QUIET))
    strong = inside & (power > max(PART * float(power[inside].max(initial=0.0)), FLOOR * floor))
    if not strong.any():
        raise InputError(
            "No carrier was found.",
            expected=f"a line near carrier_hz = {near_hz!r}",
            found="nothing above the noise there",
            where=f"{where}, [interferometer] carrier_hz",
            remedy="correct carrier_hz, rate_hz of [interferometer], or the column",
        )
    return float(lines[strong].min()), float(lines[strong].max())

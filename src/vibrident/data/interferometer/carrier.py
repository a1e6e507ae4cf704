"""A heterodyne signal mixed down from its carrier: two signals in quadrature at a lower rate.

Mixing and filtering are one product: the filter's coefficients times those of the carrier. The error of the estimated
carrier remains as a slope of the phase.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.interferometer.decimation import HALF, PASS, Decimated, filtered, taps
from vibrident.data.interferometer.setting import FloatArray, Signals

PIECES = 48  # pieces of the signal in which the carrier is searched
PIECE = 8192  # samples of a piece
PART = 1e-4  # the carrier's band is above this part of the largest line
FLOOR = 45.0  # it is also above this multiple of the floor …
QUIET = 0.05  # … which is this quantile of the spectrum: a wide band fills most of it
MARGIN = 1.6  # band kept over the width of the carrier's band, at least …
WHOLE = 5.0  # … and so much: a cyclic error of order 4 has sidebands five times as wide …
CLEAR = 0.1  # … where the noise of the phase, rad, stays below this
LEAST = 0.8  # least band, on either side, over the response's rate: enough for a cyclic error of fast sines …
MOST_OF_ALL = 1.0 / 32.0  # … but over that of the signal at most this …
MOST_OF_SHOCK = 1.0 / 8.0  # … and for a shock, whose pulse short filters keep apart from the ends of a record, this
ROOM = 0.8  # usable part of the room beside the carrier


@dataclass(frozen=True, eq=False)
class Baseband(Decimated):
    """A heterodyne signal, one, mixed down to two signals in quadrature."""

    carrier_hz: float  # what it is mixed with
    offset: float  # of the signal, removed: the filter lets it pass in part where the carrier's band is wide

    @staticmethod
    def around(raw: Signals, near_hz: float, response_hz: float, where: str, most: float = MOST_OF_ALL) -> Baseband:
        """Find the carrier near a frequency, and how wide its band is.

        ``raw``: one signal; ``near_hz``: its carrier, approximately; ``response_hz``: sampling rate of the sensor's
        response; ``most``: of the signal's rate that the least band may take on either side.

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
        starts = np.linspace(0, raw.samples - length, PIECES).astype(int)
        pieces = np.stack([raw.block(int(s), int(s) + length)[0] for s in starts], dtype=float)
        power = np.abs(np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * np.blackman(pieces.shape[1]))) ** 2
        low, high = _band(np.max(power, axis=0), raw.rate_hz, near_hz, room, where)
        least = max(16.0 * raw.rate_hz / PIECE, min(LEAST * response_hz, most * raw.rate_hz))
        whole = min(0.5 * WHOLE * (high - low), _clear(np.mean(power, axis=0), half))
        wide = min(max(0.5 * MARGIN * (high - low), whole, least), room)
        carrier = float(np.clip(0.5 * (low + high), near_hz - 0.5 * room, near_hz + 0.5 * room))
        wide = min(wide, ROOM * min(carrier, half - carrier))
        factor = np.clip(PASS * raw.rate_hz / wide, 2, max(raw.samples // (8 * HALF), 2))
        return Baseband(raw, int(factor), carrier, float(pieces.mean()))

    def block(self, start: int, stop: int) -> FloatArray:
        """Samples from ``start`` up to ``stop``, shape (2, stop − start)."""
        cycles = self.carrier_hz / self.raw.rate_hz
        mixed = filtered(self.raw, (1, stop - start), self.factor, self._kernel, start)[0]
        mixed -= self.offset * self._kernel.sum()
        mixed *= np.exp(-2j * np.pi * np.mod(cycles * self.factor * np.arange(start, stop), 1.0))
        return np.stack([mixed.real, mixed.imag])

    @functools.cached_property
    def _kernel(self) -> np.ndarray:
        cycles = self.carrier_hz / self.raw.rate_hz
        return 2.0 * taps(self.factor) * np.exp(-2j * np.pi * cycles * np.arange(2 * self.first + 1))


@dataclass(frozen=True, eq=False)
class Turned:
    """Two signals in quadrature, turned back by what is left of their carrier: their phase is the motion's alone."""

    raw: Signals  # the signals
    left: np.polynomial.Legendre  # phase of the carrier that is left, rad, over the index of a sample

    @property
    def samples(self) -> int:
        """Number of samples of each signal."""
        return self.raw.samples

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        return self.raw.rate_hz

    def block(self, start: int, stop: int) -> FloatArray:
        """Samples from ``start`` up to ``stop``, shape (2, stop − start)."""
        u = self.raw.block(start, stop)
        turned = (u[0] + 1j * u[1]) * np.exp(-1j * self.left(np.arange(start, stop)))
        return np.stack([turned.real, turned.imag])


def _clear(power: FloatArray, half_hz: float) -> float:
    """Band on either side of the carrier with a noise of the phase of ``CLEAR``, Hz."""
    noise = max(float(np.quantile(power, QUIET)), 1e-300)
    return CLEAR**2 * max(float(np.sum(power)) / noise - power.shape[0], 0.0) * half_hz / power.shape[0]


def _band(power: FloatArray, rate_hz: float, near_hz: float, room: float, where: str) -> tuple[float, float]:
    """Lowest and highest frequency of the carrier's band."""
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

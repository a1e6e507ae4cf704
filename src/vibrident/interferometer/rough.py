"""The approximate frequency of a motion from a piece of its phase, to choose the number of samples."""

from __future__ import annotations

import numpy as np

from vibrident.interferometer.choice import Choice
from vibrident.interferometer.decimation import PASS, Slower
from vibrident.interferometer.phase import Path, unwrapped
from vibrident.interferometer.setting import FloatArray, Held, Signals
from vibrident.interferometer.sine import peak

#: Samples used.
PIECE = 1 << 20
#: Means made from them.
MEANS = 1 << 14
#: Samples of a spectrum.
LINES = 1 << 14
#: Lines that are averaged.
SMOOTH = 5
#: Motion is above this multiple of the floor.
ABOVE = 6.0
#: Band that is kept of slow signals, over the highest frequency that stands above the noise: 16 samples of its period.
ROOM = 6.4
#: Fewest samples that are kept of slow signals.
FEWEST = 1 << 12


def rough_frequency(signals: Signals, choice: Choice) -> float:
    """Frequency of the motion, Hz; at least one period in the piece."""
    piece = _piece(signals)
    samples = piece.samples
    phase = np.concatenate(list(unwrapped(piece, choice.ellipse, (), Path())))
    every = max(samples // MEANS, 1)
    means = phase[: samples // every * every].reshape(-1, every).mean(axis=1)
    return peak(means, np.ones(means.shape[0], dtype=bool), signals.rate_hz / every)


def highest_frequency(signals: Signals, choice: Choice) -> float:
    """Frequency up to which the motion stands above the noise of the phase, Hz."""
    piece = _piece(signals)
    phase = np.concatenate(list(unwrapped(piece, choice.ellipse, (), Path())))
    return _highest(phase[None, :], signals.rate_hz)


def slower(signals: Signals) -> Slower | None:
    """Signals at the rate that their spectrum needs; None if it is theirs.

    The ellipse of a motion below a fringe is told from noise sample by sample: so it is determined as well at any rate.
    """
    factor = int(PASS * signals.rate_hz / (ROOM * _highest(_piece(signals).values, signals.rate_hz)))
    factor = min(factor, signals.samples // FEWEST)
    return Slower(signals, factor) if factor > 1 else None


def _piece(signals: Signals) -> Held:
    return Held(signals.block(0, min(signals.samples, PIECE)), signals.rate_hz)


def _highest(values: FloatArray, rate_hz: float) -> float:
    """Frequency up to which signals, shape (signals, n), stand above the noise, Hz."""
    samples = values.shape[1]
    length = min(samples, LINES)
    window = np.blackman(length) ** 2
    starts = np.linspace(0, samples - length, max(2 * samples // length - 1, 1)).astype(int)
    parts = np.concatenate([values[:, s : s + length] for s in starts])
    t = np.stack([np.ones(length), np.linspace(-1.0, 1.0, length)])
    parts = parts - (parts @ np.linalg.pinv(t)) @ t
    power = np.mean(np.abs(np.fft.rfft(parts * window, axis=1)) ** 2, axis=0)
    smooth = np.convolve(power, np.full(SMOOTH, 1.0 / SMOOTH), "same")
    floor = float(np.median(power[power.shape[0] // 2 :])) / np.log(2.0)
    above = np.flatnonzero(smooth > ABOVE * floor)
    return float(max(int(above[-1]) if above.size else 1, 1)) * rate_hz / length

"""The approximate frequency of a motion, to choose the number of samples."""

from __future__ import annotations

import numpy as np

from vibrident.data.interferometer.choice import Choice
from vibrident.data.interferometer.decimation import (
    PASS,
    at_lower_rate,
    decimated,
    filtered,
    spoilt_outputs,
    taps,
)
from vibrident.data.interferometer.phase import Path, unwrapped
from vibrident.data.interferometer.setting import BoolArray, FloatArray, Signals, held
from vibrident.data.interferometer.sine import peak

PIECE = 1 << 20  # samples in which a sine is looked for first
PERIODS = 3.0  # fewest periods in them; otherwise more samples are taken
MEANS = 1 << 14  # means made from them; also the most samples of a spectrum
SPECTRA = (
    8  # fewest spectra, half overlapping, less one: of fewer, a line of noise stands out by chance
)
SMOOTH = 5  # lines that are averaged
ABOVE = 6.0  # motion is above this multiple of the floor
# band kept of slow signals, over the highest frequency of the motion: 16 samples of its period
ROOM = 6.4
FEWEST = 1 << 12  # fewest samples that are kept of slow signals


def rough_frequency(signals: Signals, choice: Choice) -> float:
    """Return the frequency of a sine, Hz."""
    samples = PIECE
    while True:
        piece = _piece(signals, samples)
        phase = np.concatenate(list(unwrapped(piece, choice.ellipse, choice.knots, Path())))
        every = max(piece.samples // MEANS, 1)
        means = phase[: piece.samples // every * every].reshape(-1, every).mean(axis=1)
        found = peak(means, np.ones(means.shape[0], dtype=bool), signals.rate_hz / every)
        if piece.samples < samples or found * samples > PERIODS * signals.rate_hz:
            return found
        samples *= 4


def highest_frequency(signals: Signals, choice: Choice, factor: int) -> tuple[float, bool]:
    """Return the frequency up to which the motion stands above the noise of the phase, Hz, and whether light is lost.

    All of the record is looked at: a shock may be anywhere in it, and a sweep is fast at its end.

    ``factor``: by which the phase may be decimated.
    """
    path = Path()
    phase = decimated(
        unwrapped(signals, choice.ellipse, choice.knots, path), signals.samples, factor
    )
    spoilt = spoilt_outputs([(gap.start, gap.stop) for gap in path.gaps], signals.samples, factor)
    return _highest(phase[None, :], spoilt, signals.rate_hz / factor), bool(path.gaps)


def slower(signals: Signals) -> Signals | None:
    """Return two signals at the rate that their spectrum needs, with less noise in a sample; None if it is theirs.

    The ellipse of a motion below a fringe is told from noise sample by sample: so it is determined
    as well at any rate.
    """
    piece = _piece(signals, PIECE)
    values = piece.block(0, piece.samples)
    factor = int(
        PASS
        * signals.rate_hz
        / (ROOM * _highest(values, np.zeros(values.shape[1], bool), signals.rate_hz))
    )
    factor = min(factor, signals.samples // FEWEST)
    if factor <= 1:
        return None
    return at_lower_rate(
        signals,
        factor,
        lambda start, stop: filtered(signals, (2, stop - start), factor, taps(factor), start),
    )


def _piece(signals: Signals, samples: int) -> Signals:
    return held(
        signals.block(0, min(signals.samples, samples)).astype(float, copy=False), signals.rate_hz
    )


def _highest(values: FloatArray, spoilt: BoolArray, rate_hz: float) -> float:
    """Return the frequency up to which signals, shape (signals, n), stand above the noise, Hz."""
    samples = values.shape[1]
    length = max(min(samples // SPECTRA, MEANS), min(samples, 64))
    starts = np.linspace(0, samples - length, max(2 * samples // length - 1, 1)).astype(int)
    starts = np.array([s for s in starts if not spoilt[s : s + length].any()] or starts)
    window = np.blackman(length) ** 2
    line = np.stack([np.ones(length), np.linspace(-1.0, 1.0, length)])
    inverse = np.linalg.pinv(line)
    power = np.zeros(length // 2 + 1)
    for start in starts:
        part = values[:, start : start + length]
        power += np.sum(
            np.abs(np.fft.rfft((part - (part @ inverse) @ line) * window, axis=1)) ** 2, axis=0
        )
    smooth = np.convolve(power, np.full(SMOOTH, 1.0 / SMOOTH), "same")
    floor = float(np.median(power[power.shape[0] // 2 :])) / np.log(2.0)
    above = np.flatnonzero(smooth > ABOVE * floor)
    return float(max(int(above[-1]) if above.size else 1, 1)) * rate_hz / length

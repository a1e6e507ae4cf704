"""Estimate the approximate frequency of a motion, to choose the number of samples."""

from __future__ import annotations

import numpy as np

from vibrident.data.interferometer.choice import EllipseChoice
from vibrident.data.interferometer.decimation import (
    PASS_EDGE,
    at_lower_rate,
    decimated,
    filtered,
    spoilt_outputs,
    taps,
)
from vibrident.data.interferometer.phase import PhasePath, unwrapped
from vibrident.data.interferometer.setting import (
    BoolArray,
    FloatArray,
    SampledSignals,
    signals_in_memory,
)
from vibrident.data.interferometer.sine import peak_frequency

PIECE_SAMPLES = 1 << 20  # samples in which a sine is looked for first
MIN_PERIODS = 3.0  # of the sine in them; otherwise more samples are searched
SEARCHED_MEANS = (
    1 << 14
)  # means of these samples that are searched; also the most samples of a spectrum
# fewest spectra, half overlapping, less one: of fewer, a line of noise stands out by chance
MIN_SPECTRA = 8
AVERAGED_LINES = 5
MIN_MOTION_TO_FLOOR = 6.0  # motion is above this multiple of the floor
# band kept of slow signals, over the highest frequency of the motion: 16 samples of its period
BAND_TO_HIGHEST = 6.4
MIN_SAMPLES = 1 << 12  # fewest samples that are kept of slow signals


def rough_frequency(signals: SampledSignals, choice: EllipseChoice) -> float:
    """Return the approximate frequency of a sine, Hz."""
    samples = PIECE_SAMPLES
    while True:
        piece = _first_samples(signals, samples)
        phase = np.concatenate(list(unwrapped(piece, choice.ellipse, choice.knots, PhasePath())))
        every = max(piece.samples // SEARCHED_MEANS, 1)
        means = phase[: piece.samples // every * every].reshape(-1, every).mean(axis=1)
        frequency_hz = peak_frequency(
            means, np.ones(means.shape[0], dtype=bool), signals.rate_hz / every
        )
        if piece.samples < samples or frequency_hz * samples > MIN_PERIODS * signals.rate_hz:
            return frequency_hz
        samples *= 4


def highest_frequency(
    signals: SampledSignals, choice: EllipseChoice, factor: int
) -> tuple[float, bool]:
    """Return the highest frequency of the motion, Hz, and whether light is lost.

    Up to that frequency the motion stands above the noise of the phase. The entire record is
    examined: a shock may be anywhere in it, and a sweep is fast at its end.

    ``factor``: by which the phase may be decimated.
    """
    path = PhasePath()
    phase = decimated(
        unwrapped(signals, choice.ellipse, choice.knots, path), signals.samples, factor
    )
    spoilt = spoilt_outputs(path.gaps, signals.samples, factor)
    return _highest(phase[None, :], spoilt, signals.rate_hz / factor), bool(path.gaps)


def at_needed_rate(signals: SampledSignals) -> SampledSignals | None:
    """Return two signals at the lower rate that their spectrum needs; None if none is lower.

    Each sample then has less noise. The ellipse of a motion below a fringe is separated from noise
    sample by sample, so that it is determined as well at any rate.
    """
    piece = _first_samples(signals, PIECE_SAMPLES)
    values = piece.block(0, piece.samples)
    factor = int(
        PASS_EDGE
        * signals.rate_hz
        / (BAND_TO_HIGHEST * _highest(values, np.zeros(values.shape[1], bool), signals.rate_hz))
    )
    factor = min(factor, signals.samples // MIN_SAMPLES)
    if factor <= 1:
        return None
    return at_lower_rate(
        signals,
        factor,
        lambda start, stop: filtered(signals, (2, stop - start), factor, taps(factor), start),
    )


def _first_samples(signals: SampledSignals, samples: int) -> SampledSignals:
    return signals_in_memory(
        signals.block(0, min(signals.samples, samples)).astype(float, copy=False), signals.rate_hz
    )


def _highest(values: FloatArray, spoilt: BoolArray, rate_hz: float) -> float:
    """Return the frequency up to which signals, shape (signals, n), stand above the noise, Hz."""
    samples = values.shape[1]
    length = max(min(samples // MIN_SPECTRA, SEARCHED_MEANS), min(samples, 64))
    starts = np.linspace(0, samples - length, max(2 * samples // length - 1, 1)).astype(int)
    starts = np.array([s for s in starts if not spoilt[s : s + length].any()] or starts)
    window = np.blackman(length) ** 2
    line = np.stack([np.ones(length), np.linspace(-1.0, 1.0, length)])
    inverse = np.linalg.pinv(line)
    power = np.zeros(length // 2 + 1)
    for start in starts:
        piece = values[:, start : start + length]
        power += np.sum(
            np.abs(np.fft.rfft((piece - (piece @ inverse) @ line) * window, axis=1)) ** 2, axis=0
        )
    smooth = np.convolve(power, np.full(AVERAGED_LINES, 1.0 / AVERAGED_LINES), "same")
    floor = float(np.median(power[power.shape[0] // 2 :])) / np.log(2.0)
    above = np.flatnonzero(smooth > MIN_MOTION_TO_FLOOR * floor)
    return float(max(int(above[-1]) if above.size else 1, 1)) * rate_hz / length

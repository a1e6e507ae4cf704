"""The kind of motion in a record: a proposal if none is stated, a check of the stated one."""

from __future__ import annotations

import itertools

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, Excitation, FloatArray, Record
from vibrident.fit.response.bands import band_edges
from vibrident.fit.response.transform import about_mean

#: Samples that are examined.
MAX_SAMPLES = 2**18
#: A shock has this fraction of its energy …
SHOCK_ENERGY = 0.9
#: … in so small a fraction of its samples; a sine needs 0.7 of them, Gaussian noise 0.4.
MAX_SHOCK_SAMPLES = 0.2
#: A tone lies within so many lines of its peak.
LOBE_LINES = 3
#: A tone is so many times as strong as anything else.
MIN_TONE_RATIO = 5.0
#: In a piece of a sweep the tone holds this fraction of the power.
MIN_PIECE_POWER = 0.5
#: Number of pieces that a sweep is cut into.
PIECES = 32
#: Fewest samples of a piece.
MIN_SAMPLES = 32
#: Fraction of the pieces that must hold a tone.
MIN_TONE_PIECES = 0.7
#: Rank correlation of that tone's frequency with time.
MIN_RANK_CORRELATION = 0.9
#: Lines of a multisine hold 90 % of the power in less than this fraction of the lines between the
#: first and the last.
MAX_DENSITY = 0.2
#: Lines on either side of a tone that belong to it, and to its harmonics …
TONE_LINES = 3
#: … or this fraction of its frequency.
TONE_FRACTION = 0.25


def kind_of_motion(motion: FloatArray) -> Excitation:
    """Return the excitation that a reference looks like: sine, multisine, sweep, random or shock.

    Args:
        motion: evenly sampled, shape (n,); samples that are not finite are left out.
    """
    series = np.asarray(motion, dtype=float)
    series = series[np.isfinite(series)]
    if series.size < MIN_SAMPLES:
        return "sine"
    energies = np.sort((series - np.median(series)) ** 2)[::-1]
    if energies[0] == 0.0:
        return "sine"
    if (
        np.searchsorted(np.cumsum(energies), SHOCK_ENERGY * np.sum(energies))
        < MAX_SHOCK_SAMPLES * series.size
    ):
        return "shock"
    series = _without_trend(series[:MAX_SAMPLES])
    power = _power(series)
    if _is_tone(power):
        return "sine"
    if _is_sweep(series):
        return "sweep"
    return "multisine" if _is_sparse(power) else "random"


def stray_motion(record: Record, frequency_hz: float) -> float:
    """Return the power of motion that is not the tone, over the power of the tone.

    What counts is in the reference and answered by the response (coherent with it), beyond half the
    tone's frequency, and no harmonic: noise of a channel, drift and distortion are no other motion.

    Args:
        record: with a reference.
        frequency_hz: of the tone.
    """
    used = record.mask
    spectra = _spectrum(np.asarray(record.reference), used), _spectrum(record.response, used)
    power = np.abs(spectra[0]) ** 2
    width = record.sampling_rate_hz / record.samples
    order = np.arange(power.size) * width / frequency_hz
    at_tone = np.abs(order - 1.0) * frequency_hz <= TONE_LINES * width
    harmonic_width = min(TONE_LINES * width, TONE_FRACTION * frequency_hz)
    tone = at_tone | (np.abs(order - np.round(order)) * frequency_hz <= harmonic_width)
    spectra = tuple(np.where(tone, 0.0, lines) for lines in spectra)
    stray = 0.0
    for a, b in itertools.pairwise(band_edges(record.samples, record.sampling_rate_hz).astype(int)):
        if order[a] < 0.5:
            continue
        reference, response = (lines[a:b][~tone[a:b]] for lines in spectra)
        count = reference.size
        total = float(np.sum(np.abs(reference) ** 2)), float(np.sum(np.abs(response) ** 2))
        if count < 2 or min(total) <= 0.0:
            continue
        cross = float(np.abs(np.sum(response * np.conj(reference))) ** 2)
        coherence = cross / (total[0] * total[1])
        stray += max(coherence - (1.0 - coherence) / (count - 1.0), 0.0) * total[0]
    tone_power = float(np.sum(power[at_tone]))
    return stray / tone_power if tone_power > 0.0 else np.inf


def _spectrum(series: FloatArray, used: BoolArray) -> np.ndarray:
    """Return the windowed spectrum of the used samples about their mean."""
    return np.asarray(fft.rfft(about_mean(series, used) * np.hanning(series.size)))


def _without_trend(series: FloatArray) -> FloatArray:
    """Return a series without its mean and trend."""
    place = np.linspace(-1.0, 1.0, series.size)
    return series - np.mean(series) - place * (place @ series) / (place @ place)


def _power(series: FloatArray) -> FloatArray:
    """Return the power of the lines of a windowed series."""
    return np.abs(np.asarray(fft.rfft(series * np.hanning(series.size)))) ** 2


def _lobe(power: FloatArray) -> float:
    """Return the power of the strongest line and its neighbours."""
    peak = int(np.argmax(power))
    return float(np.sum(power[max(peak - LOBE_LINES, 0) : peak + LOBE_LINES + 1]))


def _is_tone(power: FloatArray) -> bool:
    """Return whether one tone holds nearly all the power."""
    peak = int(np.argmax(power))
    without_peak = power.copy()
    without_peak[max(peak - 2 * LOBE_LINES, 0) : peak + 2 * LOBE_LINES + 1] = 0.0
    return _lobe(power) > MIN_TONE_RATIO * _lobe(without_peak)


def _is_sweep(series: FloatArray) -> bool:
    """Return whether pieces of a series hold tones whose frequency rises or falls with time."""
    size = series.size // PIECES
    if size < MIN_SAMPLES:
        return False
    power = np.stack([_power(piece) for piece in series[: PIECES * size].reshape(PIECES, size)])
    total = power.sum(axis=1)
    loud = total > 1e-3 * np.max(total)
    has_tone = np.array([_lobe(row) for row in power]) > MIN_PIECE_POWER * total
    if (
        np.sum(has_tone & loud) < MIN_TONE_PIECES * np.sum(loud)
        or np.sum(has_tone & loud) < 0.5 * PIECES
    ):
        return False
    peaks = np.argmax(power[has_tone & loud], axis=1)
    if np.ptp(peaks) < 2:
        return False
    rank = np.corrcoef(np.argsort(np.argsort(peaks, kind="stable")), np.arange(peaks.size))[0, 1]
    return bool(abs(rank) > MIN_RANK_CORRELATION)


def _is_sparse(power: FloatArray) -> bool:
    """Return whether few of the lines hold nearly all the power, though they are far apart."""
    order = np.argsort(power)[::-1]
    strongest = order[
        : int(np.searchsorted(np.cumsum(power[order]), SHOCK_ENERGY * np.sum(power))) + 1
    ]
    return bool(strongest.size < MAX_DENSITY * (np.ptp(strongest) + 1))

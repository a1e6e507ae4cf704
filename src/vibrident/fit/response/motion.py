"""The kind of motion in a record: a proposal if no kind is stated, a contradiction if the stated one is wrong."""

from __future__ import annotations

import itertools

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, Excitation, FloatArray, Record
from vibrident.fit.response.bands import band_edges
from vibrident.fit.response.transform import about_mean

#: Samples looked at.
MOST_SAMPLES = 2**18
#: A shock has this part of its energy …
ENERGY = 0.9
#: … in so small a part of its samples; a sine needs 0.7 of them, Gaussian noise 0.4.
BRIEF = 0.2
#: A tone lies within so many lines of its peak.
LOBE = 3
#: It is so many times as strong as anything else.
ALONE = 5.0
#: Of a piece of a sweep it holds this part of the power.
MOSTLY = 0.5
#: Pieces that a sweep is cut into.
PIECES = 32
#: Fewest samples of each.
FEWEST = 32
#: Part of the pieces that must hold a tone of their own.
OWN_TONE = 0.7
#: Rank correlation of that tone's frequency with time.
ORDERED = 0.9
#: Lines of a multisine hold 90 % of the power in less than this part of the lines between the first and the last.
SPARSE = 0.2
#: Lines on either side of a tone that are its own, and its harmonics' …
BESIDE = 3
#: … or this part of its frequency.
PART = 0.25


def kind_of_motion(motion: FloatArray) -> Excitation:
    """The excitation that a reference looks like: sine, multisine, sweep, random or shock.

    Args:
        motion: evenly sampled, shape (n,); samples that are not numbers count as zero motion.
    """
    series = np.asarray(motion, dtype=float)
    series = series[np.isfinite(series)]
    if series.size < FEWEST:
        return "sine"
    brief = np.sort((series - np.median(series)) ** 2)[::-1]
    if brief[0] == 0.0:
        return "sine"
    if np.searchsorted(np.cumsum(brief), ENERGY * np.sum(brief)) < BRIEF * series.size:
        return "shock"
    series = _without_trend(series[:MOST_SAMPLES])
    power = _power(series)
    if _is_tone(power):
        return "sine"
    if _is_sweep(series):
        return "sweep"
    return "multisine" if _is_sparse(power) else "random"


def stray_motion(record: Record, frequency_hz: float) -> float:
    """Power of motion that is not the tone said to be there, over the power of that tone.

    What counts is in the reference and answered by the response (coherent with it), beyond half the tone's frequency,
    and no harmonic: noise of a channel, drift and distortion are no other motion.
    """
    used = record.mask
    spectra = _spectrum(np.asarray(record.reference), used), _spectrum(record.response, used)
    power = np.abs(spectra[0]) ** 2
    width = record.sampling_rate_hz / record.samples
    order = np.arange(power.size) * width / frequency_hz
    own = np.abs(order - 1.0) * frequency_hz <= BESIDE * width
    near = min(BESIDE * width, PART * frequency_hz)
    tone = own | (np.abs(order - np.round(order)) * frequency_hz <= near)
    spectra = tuple(np.where(tone, 0.0, lines) for lines in spectra)
    stray = 0.0
    for a, b in itertools.pairwise(band_edges(record.samples, record.sampling_rate_hz).astype(int)):
        if order[a] < 0.5:
            continue
        one, other = (lines[a:b][~tone[a:b]] for lines in spectra)
        count = one.size
        total = float(np.sum(np.abs(one) ** 2)), float(np.sum(np.abs(other) ** 2))
        if count < 2 or min(total) <= 0.0:
            continue
        coherence = float(np.abs(np.sum(other * np.conj(one))) ** 2) / (total[0] * total[1])
        stray += max(coherence - (1.0 - coherence) / (count - 1.0), 0.0) * total[0]
    whole = float(np.sum(power[own]))
    return stray / whole if whole > 0.0 else np.inf


def _spectrum(series: FloatArray, used: BoolArray) -> np.ndarray:
    return np.asarray(fft.rfft(about_mean(series, used) * np.hanning(series.size)))


def _without_trend(series: FloatArray) -> FloatArray:
    place = np.linspace(-1.0, 1.0, series.size)
    return series - np.mean(series) - place * (place @ series) / (place @ place)


def _power(series: FloatArray) -> FloatArray:
    return np.abs(np.asarray(fft.rfft(series * np.hanning(series.size)))) ** 2


def _lobe(power: FloatArray) -> float:
    """Power of the strongest line and those beside it."""
    peak = int(np.argmax(power))
    return float(np.sum(power[max(peak - LOBE, 0) : peak + LOBE + 1]))


def _is_tone(power: FloatArray) -> bool:
    peak = int(np.argmax(power))
    rest = power.copy()
    rest[max(peak - 2 * LOBE, 0) : peak + 2 * LOBE + 1] = 0.0
    return _lobe(power) > ALONE * _lobe(rest)


def _is_sweep(series: FloatArray) -> bool:
    size = series.size // PIECES
    if size < FEWEST:
        return False
    power = np.stack([_power(piece) for piece in series[: PIECES * size].reshape(PIECES, size)])
    total = power.sum(axis=1)
    loud = total > 1e-3 * np.max(total)
    own = np.array([_lobe(row) for row in power]) > MOSTLY * total
    if np.sum(own & loud) < OWN_TONE * np.sum(loud) or np.sum(own & loud) < 0.5 * PIECES:
        return False
    peaks = np.argmax(power[own & loud], axis=1)
    if np.ptp(peaks) < 2:
        return False
    rank = np.corrcoef(np.argsort(np.argsort(peaks, kind="stable")), np.arange(peaks.size))[0, 1]
    return bool(abs(rank) > ORDERED)


def _is_sparse(power: FloatArray) -> bool:
    """Whether few of the lines hold nearly all the power, though they are far apart."""
    order = np.argsort(power)[::-1]
    few = order[: int(np.searchsorted(np.cumsum(power[order]), ENERGY * np.sum(power))) + 1]
    return bool(few.size < SPARSE * (np.ptp(few) + 1))

"""Test of the sampling rate by the stated frequencies of tones."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from vibrident.base.brief import first_names
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.screening import ScreeningFinding
from vibrident.fit.response.sine_fit import phasors, spectral_peak, tone_frequency
from vibrident.fit.response.tone_quality import MIN_PERIODS
from vibrident.fit.response.transform import median

#: Common ratio of tones to the stated frequencies, less one, above which the clock is suspect:
#: nominal frequencies (ISO 266) are up to 0.9 % off the exact ones.
MIN_OFFSET = 0.015
#: The same for a single frequency, which may have been stated roughly.
MIN_SINGLE_OFFSET = 0.05
#: Uncertainty of the place of a tone, in lines of the record's spectrum.
PLACE_UNCERTAINTY_LINES = 0.02
#: The strongest tone is the record's if at most this share of the power is anything else.
MAX_OTHER_POWER = 0.3
MAX_NAMES = 3  # of records in a message


def judge_clocks(
    records: Sequence[Record],
) -> tuple[tuple[Record, ...], tuple[ScreeningFinding, ...]]:
    """Return the records, and a finding where tones contradict the sampling rate.

    The stated frequencies are removed from the records then, as they are no start values.
    """
    stated = [
        r
        for r in records
        if r.excitation == "sine" and r.frequency_hz is not None and r.reference is not None
    ]
    ratio = _common_ratio(stated)
    if ratio is None:
        return tuple(records), ()
    names = first_names([record.name for record in stated], MAX_NAMES)
    text = (
        f"In {names} the tone lies at {ratio:.6g} times the stated frequency_hz: the "
        "sampling rate, or frequency_hz, is wrong by that factor."
    )
    corrected = tuple(
        dataclasses.replace(r, frequency_hz=None) if r.excitation == "sine" else r for r in records
    )
    return corrected, (ScreeningFinding("clock_suspect", text),)


def _common_ratio(records: Sequence[Record]) -> float | None:
    """Return the ratio of measured to stated frequency of all records; None if 1 or not shared."""
    ratios = []
    uncertainties = []
    right = 0
    for record in records:
        assert record.frequency_hz is not None
        tone_hz = _tone(record, record.frequency_hz)
        if tone_hz is None:
            return None
        ratios.append(tone_hz / record.frequency_hz)
        right += abs(ratios[-1] - 1.0) < MIN_OFFSET
        if 2 * right > len(records):  # so is the median
            return None
        uncertainties.append(PLACE_UNCERTAINTY_LINES / (record.duration_s * record.frequency_hz))
    if not ratios:
        return None
    ratio = float(median(np.array(ratios)))
    uncertainty = max(uncertainties)
    offset = abs(ratio - 1.0)
    several = len({r.frequency_hz for r in records}) > 1
    if offset < max(MIN_OFFSET if several else MIN_SINGLE_OFFSET, 3 * uncertainty):
        return None
    # Ratios agree where they differ by less than a tenth of their distance from one.
    spread = float(np.max(np.abs(np.array(ratios) - ratio)))
    return ratio if spread <= 0.1 * offset + uncertainty else None


def _tone(record: Record, stated_hz: float) -> float | None:
    """Return the frequency of the tone that holds most of the power of the reference, Hz.

    None without such a tone, or where it is hum and the record has a tone at the stated frequency.
    """
    mask = record.mask
    rate = record.sampling_rate_hz
    motion = _without_trend(np.asarray(record.reference), mask)
    start = spectral_peak([motion], mask, rate, None)
    if start * record.duration_s < MIN_PERIODS:
        return None
    tone_hz = tone_frequency(record, start) if start < rate / 2 else start
    amplitude, remainder = _without_tone(motion, mask, rate, tone_hz)
    if np.sum(remainder**2) > MAX_OTHER_POWER * np.sum(motion**2):
        return None
    if abs(tone_hz / stated_hz - 1.0) > MIN_OFFSET:
        near = spectral_peak([remainder], mask, rate, stated_hz)
        if _without_tone(remainder, mask, rate, near)[0] > 0.05 * amplitude:  # harmonics are less
            return None
    return tone_hz


def _without_trend(values: FloatArray, mask: BoolArray) -> FloatArray:
    """Return a series less offset and trend, zero where it is not valid, shape (samples,)."""
    place = np.arange(values.size) - np.flatnonzero(mask).mean()
    level = values[mask].mean()
    slope = np.sum(place[mask] * (values[mask] - level)) / max(float(np.sum(place[mask] ** 2)), 1.0)
    return np.where(mask, values - level - slope * place, 0.0)


def _without_tone(
    motion: FloatArray, mask: BoolArray, rate_hz: float, frequency_hz: float
) -> tuple[float, FloatArray]:
    """Return the amplitude of a tone, and the motion without it, shape (samples,)."""
    wave = phasors(motion.size, 2 * np.pi * frequency_hz / rate_hz) * mask
    waves = np.stack([wave.real, wave.imag])
    coefficients, *_ = np.linalg.lstsq(waves @ waves.T, waves @ motion, rcond=None)
    return float(np.hypot(*coefficients)), motion - coefficients @ waves

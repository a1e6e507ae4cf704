"""Test of the sampling rate by the stated frequencies of tones."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.screening import Finding
from vibrident.fit.response.tone_quality import FEWEST_PERIODS
from vibrident.fit.response.tones import spectral_peak, tone_frequency, turning
from vibrident.fit.response.transform import median

#: Tones in one ratio to what is stated, that far from one; a single record may have been given a rough frequency_hz.
#: Nominal frequencies (ISO 266) are up to 0.9 % off the exact ones.
LEAST_RATIO, LEAST_OF_ONE = 0.015, 0.05
#: How well a tone is located, in lines of the record's spectrum.
LINES = 0.02
#: A tone found without help is the record's tone where so little of the power is anything else.
MOST_OTHER = 0.3


def judge_clocks(records: Sequence[Record]) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """Say where the sampling rate is contradicted; a start value that the tones contradict is no longer used."""
    stated = [
        r
        for r in records
        if r.excitation == "sine" and r.frequency_hz is not None and r.reference is not None
    ]
    ratio = _common_ratio(stated)
    if ratio is None:
        return tuple(records), ()
    text = (
        f"In {_named(stated)} the tone lies at {ratio:.6g} times the stated frequency_hz: the sampling rate, or "
        "frequency_hz, is wrong by that factor."
    )
    kept = tuple(
        dataclasses.replace(r, frequency_hz=None) if r.excitation == "sine" else r for r in records
    )
    return kept, (Finding("clock_suspect", text),)


def _common_ratio(records: Sequence[Record]) -> float | None:
    """The ratio of found to stated frequency that all these sine records share; None if it is one or not shared."""
    ratios, allowed = [], []
    for record in records:
        assert record.frequency_hz is not None
        found = _tone(record, record.frequency_hz)
        if found is None:
            return None
        ratios.append(found / record.frequency_hz)
        allowed.append(LINES / (record.duration_s * record.frequency_hz))
    if not ratios:
        return None
    ratio, doubt = float(median(np.array(ratios))), max(allowed)
    off = abs(ratio - 1.0)
    if off < max(
        LEAST_RATIO if len({r.frequency_hz for r in records}) > 1 else LEAST_OF_ONE, 3 * doubt
    ):
        return None
    # They are the same where they differ by less than a tenth of their distance from one.
    return ratio if float(np.max(np.abs(np.array(ratios) - ratio))) <= 0.1 * off + doubt else None


def _tone(record: Record, stated_hz: float) -> float | None:
    """Frequency of the tone that most of the reference's power belongs to, Hz.

    None where there is no such tone, or where it is another's (hum) and the record's own is heard where it should be.
    """
    mask, rate = record.mask, record.sampling_rate_hz
    motion = _without_trend(np.asarray(record.reference), mask)
    start = spectral_peak(motion, mask, rate, None)
    if start * record.duration_s < FEWEST_PERIODS:
        return None
    found = tone_frequency(record, start) if start < rate / 2 else start
    amplitude, rest = _without_tone(motion, mask, rate, found)
    if np.sum(rest**2) > MOST_OTHER * np.sum(motion**2):
        return None
    if abs(found / stated_hz - 1.0) > LEAST_RATIO:
        near = spectral_peak(rest, mask, rate, stated_hz)
        if _without_tone(rest, mask, rate, near)[0] > 0.05 * amplitude:  # harmonics are less
            return None
    return found


def _without_trend(values: FloatArray, mask: BoolArray) -> FloatArray:
    """What is left of a series without its offset and trend, zero where it is not valid; shape (samples,)."""
    place = np.arange(values.size) - np.flatnonzero(mask).mean()
    level = values[mask].mean()
    slope = np.sum(place[mask] * (values[mask] - level)) / max(float(np.sum(place[mask] ** 2)), 1.0)
    return np.where(mask, values - level - slope * place, 0.0)


def _without_tone(
    motion: FloatArray, mask: BoolArray, rate_hz: float, frequency_hz: float
) -> tuple[float, FloatArray]:
    """Amplitude of a tone, and what is left without it, shape (samples,)."""
    wave = turning(motion.size, 2 * np.pi * frequency_hz / rate_hz) * mask
    waves = np.stack([wave.real, wave.imag])
    parts, *_ = np.linalg.lstsq(waves @ waves.T, waves @ motion, rcond=None)
    return float(np.hypot(*parts)), motion - parts @ waves


def _named(records: Sequence[Record]) -> str:
    """The first three by name."""
    names = ", ".join(record.name for record in records[:3])
    return names + (f" and {len(records) - 3} more" if len(records) > 3 else "")

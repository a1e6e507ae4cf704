"""Tones of the response that no motion explains: mains hum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy import fft

from vibrident.measure.response import ComplexArray
from vibrident.measure.tones import hann
from vibrident.records import BoolArray, FloatArray, Record

#: A line this many times above the median of the lines around is a tone, and none of the motion where the prediction
#: does not stand out there.
STANDS_OUT = 40.0
#: Lines around on either side …
AROUND = 40
#: … but the nearest.
NEAREST = 4
#: So many lines from a line of the motion it is another.
APART = 0.4
#: Largest number of hum tones; more significant tones are a misfit.
MOST_TONES = 6
#: Fewest samples.
SHORTEST = 256
#: Rounds in which all frequencies are refined.
ROUNDS = 3


def without_hum(records: Sequence[Record], predicted: Sequence[FloatArray]) -> tuple[tuple[Record, ...], int]:
    """The records with hum taken out of their response, and how many had any.

    Args:
        records: the records; sines are not changed, their tones differ from hum in frequency.
        predicted: response that a model predicts for each, shape (samples,), NaN where it is not defined.
    """
    kept, count = [], 0
    for record, series in zip(records, predicted, strict=True):
        used = record.mask & np.isfinite(series)
        if record.excitation == "sine" or record.reference is None or used.sum() < SHORTEST:
            kept.append(record)
            continue
        residual = np.where(used, record.response - series, 0.0)
        tones = _tones(residual, np.where(used, series - np.mean(series[used]), 0.0), used)
        if tones.size:
            amounts, *_ = np.linalg.lstsq(_waves(tones, used)[used], residual[used], rcond=None)
            hum = _waves(tones, np.ones_like(used)) @ amounts
            found = ", ".join(f"{hz:.4g}" for hz in tones * record.sampling_rate_hz / record.samples)
            kept.append(record.with_response(record.response - hum, f"hum at {found} Hz removed"))
            count += 1
        else:
            kept.append(record)
    return tuple(kept), count


def _tones(residual: FloatArray, motion: FloatArray, used: BoolArray) -> FloatArray:
    """Places of the tones, in lines and parts of one; empty if there are more than hum has."""
    moving = np.abs(np.asarray(fft.rfft(motion * hann(motion.size)))) ** 2
    places = np.zeros(0)
    left = residual
    while True:
        place = _strongest(np.asarray(fft.rfft(left * hann(left.size))), moving)
        if place is None:
            return places
        if places.size == MOST_TONES:
            return np.zeros(0)
        places = np.append(places, place)
        for _ in range(ROUNDS):
            waves = _waves(places, used)[used]
            sloped = (np.flatnonzero(used)[:, None] / used.size) * waves
            amounts, *_ = np.linalg.lstsq(np.concatenate([waves, sloped], axis=1), residual[used], rcond=1e-9)
            cosine, sine, late_cosine, late_sine = np.split(amounts, 4)
            # a cos φ + b sin φ of a tone whose place is off by d lines changes with time as 2π d (b cos φ − a sin φ).
            size = np.maximum(cosine**2 + sine**2, np.finfo(float).tiny)
            places = places + np.clip((late_cosine * sine - late_sine * cosine) / size / (2.0 * np.pi), -0.5, 0.5)
        left = residual.copy()
        waves = _waves(places, used)[used]
        left[used] -= waves @ np.linalg.lstsq(waves, residual[used], rcond=None)[0]


def _strongest(lines: ComplexArray, moving: FloatArray) -> float | None:
    """Place of the strongest significant line that is not of the motion."""
    power = np.abs(lines) ** 2
    for peak in (np.argsort(-power[2:-2])[: 4 * MOST_TONES] + 2).tolist():
        if power[peak] < max(power[peak - 1], power[peak + 1]) or not _stands_out(power, peak):
            continue
        place = _summit(power, peak)
        tops = [m for m in (peak - 1, peak, peak + 1) if 1 < m < power.size - 2]
        tops = [m for m in tops if moving[m] >= max(moving[m - 1], moving[m + 1]) and _stands_out(moving, m)]
        if all(abs(_summit(moving, m) - place) > APART for m in tops):
            return place
    return None


def _stands_out(power: FloatArray, peak: int) -> bool:
    around = np.concatenate(
        [power[max(peak - AROUND, 1) : max(peak - NEAREST, 1)], power[peak + NEAREST + 1 : peak + AROUND]]
    )
    return bool(around.size and power[peak] > STANDS_OUT * np.median(around))


def _summit(power: FloatArray, peak: int) -> float:
    """Place of a peak between its lines."""
    low, middle, high = np.log(np.maximum(power[peak - 1 : peak + 2], np.finfo(float).tiny))
    curved = low - 2.0 * middle + high
    return peak + float(np.clip(0.5 * (low - high) / curved, -0.5, 0.5)) if curved < 0.0 else float(peak)


def _waves(places: FloatArray, used: BoolArray) -> FloatArray:
    """Cosines, then sines, shape (samples, 2 tones); zero where not used."""
    angle = 2.0 * np.pi / used.size * np.outer(np.arange(used.size), places)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1) * used[:, None]

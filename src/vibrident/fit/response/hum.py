"""Tones of the response that no motion explains: mains hum.

The residual of a prediction shows hum, but does not measure it: initial states and parameters have
taken a part of it, and near a resonance or a line of the motion it cannot be separated from these.
So a fit gets the frequencies alone (:attr:`vibrident.data.records.Record.hum_hz`), and amplitude,
phase and their slow change are its unknowns. Mains have one frequency: a tone of two records is
assumed in all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.response.sine_fit import response_sine
from vibrident.fit.response.transform import hann, log_peak_shift, median, power_of, waves

#: A line this many times the median of the lines around is a tone; of the motion, where the
#: prediction has a tone there.
MIN_PEAK_RATIO = 40.0
#: A tone at any line of the motion is hum only if residual over prediction exceeds the median
#: around by this factor.
MIN_MISFIT_RATIO = 4.0
#: The lines around are at most this far on either side …
MAX_AROUND_LINES = 40
#: … and at least this far.
MIN_AROUND_LINES = 4
#: A tone farther than this from a line of the motion is not that line.
MIN_DISTANCE_LINES = 0.4
#: Tones closer than this are one: within a resonance no record locates it better.
MAX_SAME_LINES = 2.0
#: A tone is the fundamental of a harmonic within so many times its scatter among the records.
MAX_HARMONIC_SCATTER = 15.0
#: Largest number of hum tones; more significant tones are a misfit.
MAX_TONES = 6
#: Subtracting a tone leaves less than this fraction of it, unlike a resonance's ringing.
MAX_REMAINDER = 0.01
#: Fewest samples.
MIN_SAMPLES = 256

Tones = tuple[tuple[float, ...], ...]


def hum_tones(
    records: Sequence[Record], predicted: Sequence[FloatArray], known: Tones = ()
) -> Tones:
    """Return the frequencies of hum in the response of each record, Hz.

    Args:
        records: the records.
        predicted: response that a model predicts for each, shape (samples,), NaN where it is not
            defined.
        known: tones of each record from earlier searches, which stay even if not found again.
    """
    known = known or ((),) * len(records)
    significant = [
        tone
        for index, (record, series) in enumerate(zip(records, predicted, strict=True))
        for tone in _residual_tones(index, record, series)
    ]
    shared, single = _shared_tones(significant, records)
    common = _as_harmonics(shared)
    common += _fundamentals(
        common,
        [*(tone.hz for tone in single), *(hz for of_record in known for hz in of_record)],
        records,
    )
    hum = []
    for index, record in enumerate(records):
        line = record.sampling_rate_hz / record.samples
        same_hz = MAX_SAME_LINES * line
        usable = record.reference is not None and record.samples >= MIN_SAMPLES
        tones = [hz for hz in common if usable]
        tones += [t.hz for t in single if t.record == index and _apart(t.hz, tones, same_hz)]
        tones += [hz for hz in known[index] if _apart(hz, tones, same_hz)]
        hum.append(tuple(sorted(hz for hz in tones if hz < 0.5 * record.sampling_rate_hz)))
    return tuple(hum)


def _apart(hz: float, tones: Sequence[float], least: float) -> bool:
    """Return whether a frequency differs from those of all tones by more than ``least`` Hz."""
    return all(abs(hz - tone) > least for tone in tones)


def lacking(wanted: Tones, known: Sequence[Sequence[float]], records: Sequence[Record]) -> bool:
    """Return whether a tone of a record's hum is missing among its known ones.

    A known tone stands for all within half a line.
    """
    return any(
        all(abs(hz - known_hz) * record.duration_s > 0.5 for known_hz in known_tones)
        for tones, known_tones, record in zip(wanted, known, records, strict=True)
        for hz in tones
    )


@dataclass(frozen=True)
class _Tone:
    """Tone of the residual of a record.

    Attributes:
        record: index of the record.
        hz: frequency.
        weight: strength times squared duration, which grows with the precision of the frequency.
    """

    record: int
    hz: float
    weight: float


def _residual_tones(index: int, record: Record, predicted: FloatArray) -> list[_Tone]:
    """Return the tones in the residual of the record ``index``.

    Args:
        index: of the record.
        record: with its response.
        predicted: response of a model, shape (samples,), NaN where it is not defined.
    """
    if record.excitation == "sine" and not np.any(np.isfinite(predicted)):
        predicted = response_sine(record)  # the model's network does not reach it
    used = record.mask & np.isfinite(predicted)
    if record.reference is None or used.sum() < MIN_SAMPLES:
        return []
    span = span_of(used)  # a window over more would cut a tone off where the prediction begins
    residual = np.where(used, record.response - predicted, 0.0)[span]

    def motion_power() -> FloatArray:
        return _power(np.where(used, predicted - np.mean(predicted[used]), 0.0)[span])

    tones = _tones(residual, motion_power, used[span], harmonics=record.excitation == "sine")
    duration = residual.size / record.sampling_rate_hz
    return [_Tone(index, place / duration, strength * duration**2) for place, strength in tones]


def _shared_tones(
    tones: Sequence[_Tone], records: Sequence[Record]
) -> tuple[list[tuple[float, float]], list[_Tone]]:
    """Return frequency and scatter in Hz of tones that two records have, and the other tones."""
    remaining = sorted(tones, key=lambda tone: -tone.weight)
    durations = [record.duration_s for record in records]
    shared: list[tuple[float, float]] = []
    single: list[_Tone] = []
    while remaining:
        hz = remaining[0].hz
        duration = durations[remaining[0].record]
        near = [
            tone
            for tone in remaining
            if abs(tone.hz - hz) * min(durations[tone.record], duration) < MAX_SAME_LINES
        ]
        remaining = [tone for tone in remaining if tone not in near]
        if len({tone.record for tone in near}) > 1:
            shared.append(_middle(near))
        else:
            single += near
    return shared[:MAX_TONES], single


def _middle(tones: Sequence[_Tone]) -> tuple[float, float]:
    """Return the weighted median of the frequencies and the median distance from it, Hz."""
    hz, weight = (np.array([getattr(tone, name) for tone in tones]) for name in ("hz", "weight"))
    order = np.argsort(hz)
    middle = float(hz[order][np.searchsorted(np.cumsum(weight[order]), 0.5 * np.sum(weight))])
    return middle, float(np.median(np.abs(hz - middle)))


def _as_harmonics(tones: Sequence[tuple[float, float]]) -> list[float]:
    """Return the frequencies of tones; a poorly known one is derived from a harmonic.

    Within a resonance a frequency is poorly known; one of its harmonics may be known better.

    Args:
        tones: frequency and scatter of each, Hz.
    """
    frequencies_hz = []
    for hz, scatter in tones:
        candidates = [
            harmonic / k
            for harmonic, harmonic_scatter in tones
            for k in (2, 3)
            if harmonic_scatter < scatter
        ]
        near = (c for c in candidates if abs(c - hz) < MAX_HARMONIC_SCATTER * scatter)
        frequencies_hz.append(min(near, key=lambda c: abs(c - hz), default=hz))
    return frequencies_hz


def _fundamentals(
    common: Sequence[float], single: Sequence[float], records: Sequence[Record]
) -> list[float]:
    """Return the fundamentals of common harmonics that a single record shows.

    A resonance may hide them in the others.

    Args:
        common: frequencies of tones that records share, Hz.
        single: frequencies of tones of single records, Hz.
        records: the records.
    """
    line = 1.0 / max(record.duration_s for record in records)
    fundamentals: list[float] = []
    for hz in (harmonic / order for harmonic in common for order in (2, 3)):
        in_a_record = any(abs(tone - hz) < MAX_SAME_LINES * line for tone in single)
        if in_a_record and _apart(hz, [*common, *fundamentals], MAX_SAME_LINES * line):
            fundamentals.append(hz)
    return fundamentals


def _power(signal: FloatArray) -> FloatArray:
    """Return the power of the lines under a Hann window, shape (samples // 2 + 1,)."""
    return power_of(fft.rfft(signal * hann(signal.size)))


def _tones(
    residual: FloatArray,
    power_of_motion: Callable[[], FloatArray],
    used: BoolArray,
    *,
    harmonics: bool,
) -> list[tuple[float, float]]:
    """Return the place of each tone, in lines, and how far it stands out.

    Empty if hum has not so many, or if as much remains at a tone as of a resonance's ringing.

    Args:
        residual: shape (samples,).
        power_of_motion: returns the power of the lines of the predicted response.
        used: samples that count, shape (samples,).
        harmonics: whether the motion is a sine, whose harmonics are not hum.
    """
    motion: FloatArray | None = None
    places = np.zeros(0)
    sizes = np.zeros(0)
    strengths: list[float] = []
    remainder = residual
    while True:
        power = _power(remainder)
        peaks = _peaks(power)
        if peaks and motion is None:
            motion = power_of_motion()
        place = None if motion is None else _strongest(peaks, power, motion, harmonics=harmonics)
        if place is None:
            break
        size = float(power[round(place)])
        near = np.abs(places - place) < MIN_AROUND_LINES
        if places.size == MAX_TONES or np.any(size > MAX_REMAINDER * sizes[near]):
            return []
        if near.any():
            break
        places = np.append(places, place)
        sizes = np.append(sizes, size)
        strengths.append(_above(power, round(place)))
        for _ in range(3):
            cosine, sine, late_cosine, late_sine = np.split(_amounts(places, used, residual, 4), 4)
            # Where a place is off by d lines, a cos φ + b sin φ changes with time as
            # 2π d (b cos φ − a sin φ).
            squares = np.maximum(cosine**2 + sine**2, np.finfo(float).tiny)
            places = places + np.clip(
                (late_cosine * sine - late_sine * cosine) / squares / (2.0 * np.pi), -0.5, 0.5
            )
        remainder = residual.copy()
        remainder[used] -= (
            _amounts(places, used, residual, 2) @ waves(places, used.size)[: 2 * places.size]
        )[used]
    return list(zip(places.tolist(), strengths, strict=True))


def _amounts(places: FloatArray, used: BoolArray, residual: FloatArray, columns: int) -> FloatArray:
    """Return the least-squares coefficients of the first ``columns`` columns of each tone."""
    design = waves(places, used.size)[: columns * places.size, used].T
    return np.asarray(np.linalg.lstsq(design, residual[used], rcond=1e-9)[0], dtype=float)


def _peaks(power: FloatArray) -> list[int]:
    """Return the numbers of the significant lines, the strongest first."""
    inner = power[2:-2]
    limit = 4 * MAX_TONES
    largest = np.argpartition(-inner, limit)[:limit]
    largest = (largest[np.argsort(-inner[largest])] + 2).tolist()
    return [m for m in largest if _is_top(power, m) and _above(power, m) > MIN_PEAK_RATIO]


def _is_top(power: FloatArray, line: int) -> bool:
    """Return whether a line is not below its neighbours."""
    return bool(power[line] >= max(power[line - 1], power[line + 1]))


def _strongest(
    peaks: Sequence[int], power: FloatArray, motion: FloatArray, *, harmonics: bool
) -> float | None:
    """Return the place of the strongest peak that is not of the motion, or None.

    Args:
        peaks: numbers of the significant lines, the strongest first.
        power: of the residual, by line.
        motion: power of the predicted response, by line.
        harmonics: whether the motion is a sine, whose harmonics are not hum.
    """
    fundamental = _summit(motion, int(np.argmax(motion[2:-2])) + 2) if harmonics else 0.0
    relative = power / np.maximum(motion, np.finfo(float).tiny)
    for peak in peaks:
        place = _summit(power, peak)
        if harmonics and _is_harmonic(place, fundamental, power.size - 1):
            continue
        # None of the lines of a multisine that are close together stands out.
        may_be_misfit = _above(relative, peak) < MIN_MISFIT_RATIO
        of_motion = (
            m
            for m in (peak - 1, peak, peak + 1)
            if 1 < m < power.size - 2
            and _is_top(motion, m)
            and (may_be_misfit or _above(motion, m) > MIN_PEAK_RATIO)
        )
        if all(abs(_summit(motion, m) - place) > MIN_DISTANCE_LINES for m in of_motion):
            return place
    return None


def _is_harmonic(place: float, fundamental: float, half: int) -> bool:
    """Return whether a place is that of one of twenty harmonics of the motion.

    Args:
        place: in lines.
        fundamental: place of the motion, in lines.
        half: number of the line at half the sampling rate, where harmonics are mirrored.
    """
    order = np.arange(2, 21) * fundamental
    folded = np.abs((order + half) % (2 * half) - half)
    return bool(np.any(np.abs(folded - place) < 1.0))


def _above(power: FloatArray, peak: int) -> float:
    """Return the power of a line over the median of those around."""
    around = np.concatenate(
        [
            power[max(peak - MAX_AROUND_LINES, 1) : max(peak - MIN_AROUND_LINES, 1)],
            power[peak + MIN_AROUND_LINES + 1 : peak + MAX_AROUND_LINES],
        ]
    )
    return float(power[peak] / max(float(median(around)), np.finfo(float).tiny))


def _summit(power: FloatArray, peak: int) -> float:
    """Return the place of a peak between its lines."""
    return peak + log_peak_shift(power, peak, np.finfo(float).tiny)

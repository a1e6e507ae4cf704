"""Tones of the response that no motion explains: mains hum.

Hum is found in the residual of a prediction. It is not measured there: what initial states and parameters took of it is
in all lines, and near a resonance or a line of the motion it cannot be told from either. So a fit is given the
frequencies alone (:attr:`vibrident.data.records.Record.hum_hz`), and amplitude, phase and their slow change are
unknowns of it. Mains have one frequency: a tone of two records is looked for in all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import span_of
from vibrident.fit.response.tones import own_sine
from vibrident.fit.response.transform import hann, median, power_of, waves

#: A line this many times above the median of the lines around is a tone, and none of the motion where the prediction
#: does not stand out there.
STANDS_OUT = 40.0
#: Nor is one of the motion's own lines hum, however near others are, unless residual over prediction is so many times
#: the median around.
MORE_THAN_MOVES = 4.0
#: Lines around on either side …
AROUND = 40
#: … but the nearest.
NEAREST = 4
#: So many lines from a line of the motion it is another.
APART = 0.4
#: Tones that differ by less than so many lines are one: within a resonance no record tells its place better.
SAME = 2.0
#: A tone is a harmonic's fundamental where it is nearer than so many times what it differs by among the records.
HARMONIC = 15.0
#: Largest number of hum tones; more significant tones are a misfit.
MOST_TONES = 6
#: What is left beside a tone once it is taken out is below this part of it; of a resonance's ringing it is not.
REMAINS = 0.01
#: Fewest samples.
SHORTEST = 256

Tones = tuple[tuple[float, ...], ...]


def hum_tones(
    records: Sequence[Record], predicted: Sequence[FloatArray], known: Tones = ()
) -> Tones:
    """Frequencies of hum in each record's response, Hz.

    Args:
        records: the records.
        predicted: response that a model predicts for each, shape (samples,), NaN where it is not defined.
        known: tones that were seen before; those that are not seen again stay.
    """
    seen = [
        tone
        for index, (record, series) in enumerate(zip(records, predicted, strict=True))
        for tone in _seen(index, record, series)
    ]
    together, alone = _together(seen, records)
    common = _as_harmonics(together)
    common += _fundamentals(
        common, [*(tone.hz for tone in alone), *(hz for own in known for hz in own)], records
    )
    found = []
    for index, record in enumerate(records):
        line = record.sampling_rate_hz / record.samples
        tones = [hz for hz in common if record.reference is not None and record.samples >= SHORTEST]
        tones += [t.hz for t in alone if t.record == index and _apart(t.hz, tones, SAME * line)]
        tones += [hz for hz in (known[index] if known else ()) if _apart(hz, tones, SAME * line)]
        found.append(tuple(sorted(hz for hz in tones if hz < 0.5 * record.sampling_rate_hz)))
    return tuple(found)


def _apart(hz: float, tones: Sequence[float], least: float) -> bool:
    return all(abs(hz - other) > least for other in tones)


def lacking(wanted: Tones, known: Sequence[Sequence[float]], records: Sequence[Record]) -> bool:
    """Whether a record lacks a tone of its hum among those known: a nuisance tone stands for all within half a line."""
    return any(
        all(abs(hz - other) * record.duration_s > 0.5 for other in own)
        for tones, own, record in zip(wanted, known, records, strict=True)
        for hz in tones
    )


@dataclass(frozen=True)
class _Tone:
    """A tone of a record's residual; ``weight``: how well its frequency is known."""

    record: int
    hz: float
    weight: float


def _seen(index: int, record: Record, predicted: FloatArray) -> list[_Tone]:
    if record.excitation == "sine" and not np.any(np.isfinite(predicted)):
        predicted = own_sine(record)  # the model's network does not reach it
    used = record.mask & np.isfinite(predicted)
    if record.reference is None or used.sum() < SHORTEST:
        return []
    whole = span_of(used)  # a window over more would cut a tone off where the prediction begins
    residual = np.where(used, record.response - predicted, 0.0)[whole]

    def moving() -> FloatArray:
        return _power(np.where(used, predicted - np.mean(predicted[used]), 0.0)[whole])

    tones = _tones(residual, moving, used[whole], harmonics=record.excitation == "sine")
    span = residual.size / record.sampling_rate_hz
    return [_Tone(index, place / span, strength * span**2) for place, strength in tones]


def _together(
    seen: Sequence[_Tone], records: Sequence[Record]
) -> tuple[list[tuple[float, float]], list[_Tone]]:
    """Frequencies of tones that two records have, and how far these are from each other, Hz; and the other tones."""
    left, alone = sorted(seen, key=lambda tone: -tone.weight), list[_Tone]()
    span = [record.duration_s for record in records]
    found: list[tuple[float, float]] = []
    while left:
        hz, longest = left[0].hz, span[left[0].record]
        near = [tone for tone in left if abs(tone.hz - hz) * min(span[tone.record], longest) < SAME]
        left = [tone for tone in left if tone not in near]
        if len({tone.record for tone in near}) > 1:
            found.append(_middle(near))
        else:
            alone += near
    return found[:MOST_TONES], alone


def _middle(tones: Sequence[_Tone]) -> tuple[float, float]:
    """Weighted median of their frequencies, and the median of the distances from it, Hz."""
    hz, weight = (np.array([getattr(tone, name) for tone in tones]) for name in ("hz", "weight"))
    order = np.argsort(hz)
    middle = float(hz[order][np.searchsorted(np.cumsum(weight[order]), 0.5 * np.sum(weight))])
    return middle, float(np.median(np.abs(hz - middle)))


def _as_harmonics(tones: Sequence[tuple[float, float]]) -> list[float]:
    """The tones; one whose frequency is little known, as within a resonance, by a harmonic that is known better."""
    found = []
    for hz, scatter in tones:
        by_others = [other / k for other, own in tones for k in (2, 3) if own < scatter]
        near = [other for other in by_others if abs(other - hz) < HARMONIC * scatter]
        found.append(min(near, key=lambda other: abs(other - hz)) if near else hz)
    return found


def _fundamentals(
    common: Sequence[float], single: Sequence[float], records: Sequence[Record]
) -> list[float]:
    """Fundamentals of common tones that no two records agree on, as a resonance hides them, by their harmonic."""
    line = 1.0 / max(record.duration_s for record in records)
    found: list[float] = []
    for hz in (other / order for other in common for order in (2, 3)):
        seen = any(abs(tone - hz) < SAME * line for tone in single)
        if seen and _apart(hz, [*common, *found], SAME * line):
            found.append(hz)
    return found


def _power(signal: FloatArray) -> FloatArray:
    """Power of the lines under Hann's window, shape (samples // 2 + 1,)."""
    return power_of(np.asarray(fft.rfft(signal * hann(signal.size))))


def _tones(
    residual: FloatArray,
    power_of_motion: Callable[[], FloatArray],
    used: BoolArray,
    *,
    harmonics: bool,
) -> list[tuple[float, float]]:
    """Places of the tones, in lines and parts of one, and how far each stands out.

    Empty if there are more than hum has, or if as much is left beside one as of a resonance's ringing.
    """
    moving: FloatArray | None = None
    places, strengths, sizes, left = np.zeros(0), list[float](), list[float](), residual
    while True:
        power = _power(left)
        peaks = _peaks(power)
        if peaks and moving is None:
            moving = power_of_motion()
        place = None if moving is None else _strongest(peaks, power, moving, harmonics=harmonics)
        if place is None:
            return list(zip(places.tolist(), strengths, strict=True))
        size, near = float(power[round(place)]), np.abs(places - place) < NEAREST
        if places.size == MOST_TONES or any(
            size > REMAINS * s for s, n in zip(sizes, near, strict=True) if n
        ):
            return []
        if near.any():
            return list(zip(places.tolist(), strengths, strict=True))
        places, strengths, sizes = (
            np.append(places, place),
            [*strengths, _above(power, round(place))],
            [*sizes, size],
        )
        for _ in range(3):
            cosine, sine, late_cosine, late_sine = np.split(_amounts(places, used, residual, 4), 4)
            # a cos φ + b sin φ of a tone whose place is off by d lines changes with time as 2π d (b cos φ − a sin φ).
            squares = np.maximum(cosine**2 + sine**2, np.finfo(float).tiny)
            places = places + np.clip(
                (late_cosine * sine - late_sine * cosine) / squares / (2.0 * np.pi), -0.5, 0.5
            )
        left = residual.copy()
        left[used] -= (
            _amounts(places, used, residual, 2) @ waves(places, used.size)[: 2 * places.size]
        )[used]


def _amounts(places: FloatArray, used: BoolArray, residual: FloatArray, columns: int) -> FloatArray:
    """Least-squares coefficients of the first so many columns a tone."""
    design = waves(places, used.size)[: columns * places.size, used].T
    return np.asarray(np.linalg.lstsq(design, residual[used], rcond=1e-9)[0], dtype=float)


def _peaks(power: FloatArray) -> list[int]:
    """Significant lines, the strongest first."""
    inner, most = power[2:-2], 4 * MOST_TONES
    largest = np.argpartition(-inner, most)[:most] if inner.size > most else np.arange(inner.size)
    largest = (largest[np.argsort(-inner[largest])] + 2).tolist()
    return [
        m
        for m in largest
        if power[m] >= max(power[m - 1], power[m + 1]) and _above(power, m) > STANDS_OUT
    ]


def _strongest(
    peaks: Sequence[int], power: FloatArray, moving: FloatArray, *, harmonics: bool
) -> float | None:
    """Place of the first peak that is not of the motion."""
    own = _summit(moving, int(np.argmax(moving[2:-2])) + 2) if harmonics else 0.0
    over = power / np.maximum(moving, np.finfo(float).tiny)
    for peak in peaks:
        place = _summit(power, peak)
        if harmonics and _harmonic(place, own, power.size - 1):
            continue
        tops = [m for m in (peak - 1, peak, peak + 1) if 1 < m < power.size - 2]
        misfit = (
            _above(over, peak) < MORE_THAN_MOVES
        )  # of a multisine's lines close together none stands out
        tops = [m for m in tops if moving[m] >= max(moving[m - 1], moving[m + 1])]
        tops = [m for m in tops if misfit or _above(moving, m) > STANDS_OUT]
        if all(abs(_summit(moving, m) - place) > APART for m in tops):
            return place
    return None


def _harmonic(place: float, own: float, half: int) -> bool:
    """Whether a place is that of one of twenty harmonics of the motion's line, mirrored at half the sampling rate."""
    order = np.arange(2, 21) * own
    folded = np.abs((order + half) % (2 * half) - half)
    return bool(np.any(np.abs(folded - place) < 1.0))


def _above(power: FloatArray, peak: int) -> float:
    """How many times a line is above the median of those around."""
    around = np.concatenate(
        [
            power[max(peak - AROUND, 1) : max(peak - NEAREST, 1)],
            power[peak + NEAREST + 1 : peak + AROUND],
        ]
    )
    return (
        float(power[peak] / max(float(median(around)), np.finfo(float).tiny))
        if around.size
        else 0.0
    )


def _summit(power: FloatArray, peak: int) -> float:
    """Place of a peak between its lines."""
    low, middle, high = np.log(np.maximum(power[peak - 1 : peak + 2], np.finfo(float).tiny))
    curved = low - 2.0 * middle + high
    return (
        peak + float(np.clip(0.5 * (low - high) / curved, -0.5, 0.5))
        if curved < 0.0
        else float(peak)
    )

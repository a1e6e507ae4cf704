"""Tones in residuals that no motion causes: hum of the mains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrident.base.tails import chi2_tail
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.averages import (
    MIN_POWER,
    NEAREST_BINS,
    averaged_bins,
    level_around,
    log_power,
    windowed,
)
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of
from vibrident.fit.response.verdict import REJECTION, as_chi2

#: A bin this many times above its surroundings is a tone.
TONE_RATIO = 25.0
#: Most tones of a record.
MAX_TONES = 16
#: Orders of the harmonics of the mains that are looked for …
HARMONICS = (2, 3, 4, 5)
#: … and of those whose fundamental may hide in a resonance.
HIDDEN_ORDERS = (2, 3)
#: Least share of freedom of a bin whose tone shows beside the motion.
MIN_TONE_FREEDOM = 0.1
#: A sensor rings in step with a tone where its |H|² is so many times that around.
RINGING_RATIO = 4.0
#: Tones nearer than so many bins are one: a record of this length cannot separate nearer ones.
MIN_DISTANCE_BINS = 1.0
#: A known tone stays where it is this near: of a phase that turns by ±πδ over the record, its
#: columns leave at most (πδ)²/2, a five-hundredth of the tone.
MIN_MOVE_BINS = 0.02
#: Farthest move of a tone, in bins: its phase turns by half a turn over the record.
MAX_MOVE_BINS = 0.5
#: Bins on either side of a sine's tone that are of the tone.
MAX_TONE_DISTANCE = 4


def tones_of(
    residual: ComplexArray, noise: ComplexArray, level: FloatArray, moved: BoolArray
) -> tuple[tuple[float, ...], ...]:
    """Return the places, in bins, of tones so strong that their leakage hides others.

    Args:
        residual: shape (R, K).
        noise: its component that is locally incoherent with the motion, shape (R, K).
        level: power of noise around, shape (R, K).
        moved: lines of the motion, shape (R, K).

    Returns:
        Of each record, the strongest first.
    """
    # Under the window a bin is at most (1/4 + 1/2 + 1/4)² / 0.375 times the largest of three.
    strong = np.any(power_of(residual) > 0.375 * TONE_RATIO * level, axis=1)
    places: list[tuple[float, ...]] = [()] * len(residual)
    for record in np.flatnonzero(strong):
        power, incoherent_power = power_of(windowed(np.stack([residual[record], noise[record]])))
        threshold = TONE_RATIO * level[record, 2:-2]
        peaks = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])
        peaks &= np.minimum(power, incoherent_power)[1:-1] > threshold
        peaks &= ~moved[record, 2:-2]
        tops = np.flatnonzero(peaks) + 1
        tops = tops[np.argsort(-power[tops])][:MAX_TONES]
        places[record] = tuple((tops + 1 + _offsets(power, tops)).tolist())
    return tuple(places)


def tone_excess(
    residual: ComplexArray,
    noise: ComplexArray,
    level: FloatArray,
    moved: BoolArray,
    freedom: FloatArray,
) -> FloatArray:
    """Return by how much a tone may exceed the noise at each bin, shape (R, K); one is no tone.

    Of a tone at one bin the projection off the motion leaves its share of freedom. Where that is
    none, the residual alone tells.

    Args:
        residual: as of :func:`tones_of`, as are ``noise``, ``level`` and ``moved``.
        noise: shape (R, K).
        level: shape (R, K).
        moved: shape (R, K).
        freedom: share of the noise of each bin that the projection leaves, shape (R, K).
    """
    power = power_of(residual)
    before_projection = np.divide(
        power_of(noise), freedom**2, out=power.copy(), where=freedom > MIN_TONE_FREEDOM
    )
    excess = np.minimum(power, before_projection) / np.maximum(level, MIN_POWER)
    return np.where(moved, 0.0, excess)


@dataclass(frozen=True, eq=False)
class RecordTones:
    """Tones of a record's residual.

    Attributes:
        known: places of those that were fitted, in bins.
        strong: of others, the strongest first.
        excess: of the residual over the noise at each bin, shape (K,); None where nothing tells it.
        bin_hz: width of a bin, Hz.
        bins: number of bins.
        resonant: bins of a resonance, whose ringing imitates a tone, shape (K,); None: not known.
    """

    known: tuple[float, ...]
    strong: tuple[float, ...]
    excess: FloatArray | None
    bin_hz: float
    bins: int
    resonant: BoolArray | None = None

    def hides(self, hz: float) -> bool:
        """Return whether a tone at a frequency would be taken for the sensor's ringing."""
        place = round(hz / self.bin_hz)
        return self.resonant is not None and place < self.bins and bool(self.resonant[place])


def with_shared_tones(records: Sequence[RecordTones]) -> list[tuple[float, ...]]:
    """Return the places, in bins, of each record's tones, and of those it has with others.

    Mains have one frequency, and harmonics. A tone of several records is in all where most have it,
    or where the others together show it, though in each alone it might be chance. Of harmonics all
    but the record that shows one most must exceed the chance of noise: elsewhere a misfit of all
    records would pass for a tone. A tone may itself be a harmonic, whose fundamental no record
    shows where the sensor rings in step with it. Noise alone adds a tone in one of a thousand cases
    (Bonferroni).
    """
    alike = [(hz, owners) for hz, owners in tones_alike(records) if len(owners) > 1]
    limit = REJECTION / max(len(alike) * (1 + len(HARMONICS)), 1)
    in_all_hz: list[float] = []
    for hz, owners in alike:
        without = [record for number, record in enumerate(records) if number not in owners]
        in_most = 2 * len(owners) > len(records)
        if in_most or _chance_of_all(_excesses(without, hz)) < limit:
            in_all_hz.append(hz)
    shared_hz = list(in_all_hz)
    for hz in in_all_hz:
        for order in HARMONICS:
            if _chance_of_all(np.sort(_excesses(records, order * hz))[:-1]) < limit:
                shared_hz.append(order * hz)
        for order in HIDDEN_ORDERS:
            if any(record.hides(hz / order) for record in records):
                shared_hz.append(hz / order)
    return [
        with_tones(
            with_tones(record.known, record.strong),
            tuple(hz / record.bin_hz for hz in shared_hz if hz < record.bins * record.bin_hz),
        )
        for record in records
    ]


def _excesses(records: Sequence[RecordTones], hz: float) -> FloatArray:
    """Return the excess of each record at a frequency as χ² of two degrees, shape (records,)."""
    excesses: list[float] = []
    freedoms: list[float] = []
    for record in records:
        place = round(hz / record.bin_hz)
        if record.excess is not None and place < record.excess.size - 1:
            excesses.append(float(record.excess[place]))
            freedoms.append(4.0 * (averaged_bins(record.excess.size) - NEAREST_BINS))
    return np.asarray(as_chi2(2.0 * np.array(excesses), np.array(freedoms)))


def _chance_of_all(chi2: FloatArray) -> float:
    """Return the chance that noise exceeds the sum of χ² of two degrees each, shape (R,)."""
    return chi2_tail(2 * chi2.size, float(np.sum(chi2))) if chi2.size else 1.0


def resonant_bins(through: FloatArray) -> BoolArray:
    """Return the bins of resonances, shape (K,), given |H|²."""
    logarithm = log_power(through[None].copy())
    return np.asarray((logarithm - level_around(logarithm))[0] > np.log(RINGING_RATIO))


def located(place: float, signal: FloatArray) -> float:
    """Return the place of a tone, in bins, at which its phase turns no further over the record.

    Args:
        place: at which it was fitted with a slow change of amplitude and phase.
        signal: the fit, shape (N,).
    """
    samples = len(signal)
    number = np.arange(samples)
    wave: ComplexArray = np.exp(2j * np.pi * place / samples * number)
    from_middle = (number - 0.5 * (samples - 1)) / samples
    columns = np.stack([wave.real, wave.imag, from_middle * wave.real, from_middle * wave.imag])
    cosine, sine, *slopes = np.linalg.lstsq(columns.T, signal, rcond=None)[0]
    turn = complex(slopes[0], -slopes[1]) * complex(cosine, sine)
    move = turn.imag / (2.0 * np.pi * max(cosine**2 + sine**2, MIN_POWER))
    if abs(move) <= MIN_MOVE_BINS:
        return place
    return place + float(np.clip(move, -MAX_MOVE_BINS, MAX_MOVE_BINS))


def with_tones(known: tuple[float, ...], candidates: tuple[float, ...]) -> tuple[float, ...]:
    """Return known tones and new ones, in bins.

    The remainder of a known tone is no other.
    """
    tones = list(known)
    for candidate in candidates:
        if all(abs(candidate - tone) >= MIN_DISTANCE_BINS for tone in tones):
            tones.append(candidate)
    return tuple(tones[:MAX_TONES])


def tones_alike(records: Sequence[RecordTones]) -> list[tuple[float, set[int]]]:
    """Return the frequency in Hz of each tone, and the numbers of the records that have it."""
    remaining = sorted(
        (record.bin_hz, record.bin_hz * place, number)
        for number, record in enumerate(records)
        for place in (*record.known, *record.strong)
    )
    groups: list[tuple[float, set[int]]] = []
    while remaining:
        width, hz, _ = remaining[0]  # of a longest record, which locates it best
        alike = [tone for tone in remaining if abs(tone[1] - hz) < MIN_DISTANCE_BINS * tone[0]]
        remaining = [tone for tone in remaining if tone not in alike]
        best = [tone_hz for tone_width, tone_hz, _ in alike if tone_width <= width]
        groups.append((float(np.median(best)), {number for _, _, number in alike}))
    return groups


def harmonic_bins(samples: int, turns: float, count: int) -> BoolArray:
    """Return which bins are those of a sine's harmonics, which are the sensor's, shape (K,).

    Args:
        samples: of the record.
        turns: of the sine in a sample.
        count: number of bins, K.
    """
    place = turns * samples
    order = np.arange(count) / place
    return (np.abs(order - np.round(order)) * place < MAX_TONE_DISTANCE) & (np.round(order) > 0.0)


def _offsets(power: FloatArray, tops: NDArray[np.int_]) -> FloatArray:
    """Return the offsets of tones from their bins under a Hann window, −½ … ½.

    A parabola would be off by up to two hundredths of a bin.
    """
    low, middle, high = (np.sqrt(power[tops + shift]) for shift in (-1, 0, 1))
    ratio = np.maximum(low, high) / middle
    offset = np.clip((2.0 * ratio - 1.0) / (1.0 + ratio), 0.0, 0.5)
    return np.where(high > low, offset, -offset)

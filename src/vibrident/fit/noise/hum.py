"""Tones of the response that no motion explains: mains hum.

They stand out of a residual's spectrum (:mod:`vibrident.fit.noise.spectrum`). Near a tone of the motion, or within a
resonance, they do not: there the parameters and initial states take them. But mains have one frequency, so a tone of
two records is in all, and a harmonic tells its fundamental. A fit is given the frequencies alone
(:attr:`vibrident.data.records.Record.hum_hz`); amplitude, phase and their slow change are nuisance parameters of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.records import Record
from vibrident.fit.bins import RecordBins
from vibrident.fit.noise.spectrum import NoiseSpectrum

#: Tones of two records are one where they differ by less than so many bins: a bin is what a record resolves, and within
#: a resonance a tone is found beside its place.
SAME = 2.0
#: A nuisance tone of slowly changing size and phase stands for all tones within so many bins.
STANDS_FOR = 0.5
#: Harmonics that tell a fundamental.
ORDERS = (2, 3)

Tones = tuple[tuple[float, ...], ...]


def hum_of(seen: Sequence[Sequence[float]], records: Sequence[Record]) -> Tones:
    """Frequencies of hum in each record's response, Hz: its own, and those that several records have.

    Args:
        seen: tones that stand out of each record's residual, or are known, Hz.
        records: the records.
    """
    every = [(hz, index) for index, own in enumerate(seen) for hz in own if hz * records[index].duration_s > 1.0]
    common = _common(every, records)
    for hz in [one / order for one in common for order in ORDERS]:
        shown = any(_same(hz, other, records[index]) for other, index in every)
        if shown and not any(_same(hz, other, record) for other in common for record in records):
            common.append(hz)
    found = []
    for own, record in zip(seen, records, strict=True):
        heard = [hz for hz in common if record.reference is not None and hz < 0.5 * record.sampling_rate_hz]
        found.append(tuple(sorted([*heard, *(hz for hz in own if not any(_same(hz, one, record) for one in heard))])))
    return tuple(found)


def tones_of(records: Sequence[Record], lines: Sequence[RecordBins], spectra: Sequence[NoiseSpectrum]) -> Tones:
    """Tones that stand out of each record's residual, or are known, Hz."""
    return tuple(
        tuple(place * record.sampling_rate_hz / max(own.samples, 1) for place in spectrum.tones)
        for record, own, spectrum in zip(records, lines, spectra, strict=True)
    )


def lacking(wanted: Tones, known: Sequence[Sequence[float]], records: Sequence[Record]) -> bool:
    """Whether a record lacks a tone among those known."""
    return any(
        all(abs(hz - other) * record.duration_s > STANDS_FOR for other in own)
        for tones, own, record in zip(wanted, known, records, strict=True)
        for hz in tones
    )


def _same(hz: float, other: float, record: Record) -> bool:
    return abs(hz - other) * record.duration_s < SAME


def _common(every: Sequence[tuple[float, int]], records: Sequence[Record]) -> list[float]:
    """Frequencies that two records have, by those that resolve them best."""
    found, left = list[float](), sorted(every, key=lambda one: -records[one[1]].duration_s)
    while left:
        first, _ = left[0]
        near = [one for one in left if _same(one[0], first, records[one[1]])]
        left = [one for one in left if one not in near]
        if len({index for _, index in near}) > 1:
            longest = records[near[0][1]].duration_s
            best = [hz for hz, index in near if records[index].duration_s >= longest]
            found.append(float(np.median(best)))
    return found

"""Response over narrow bands for motion that is not a sine: sweeps, random, multisine, shock.

H = Σ Y X* / Σ |X|² over the spectral lines of a band (the H1 estimate; Bendat & Piersol 2010, sec. 6.1), for bands
that hold enough of the excitation. Start values and pictures come from it, never the identified parameters.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.base.tails import gamma_tail
from vibrident.data.records import BoolArray, FloatArray, Quantity, Record
from vibrident.data.records.basis import distinct
from vibrident.fit.response.alignment import TINY, aligned, bulk_delay, whitened
from vibrident.fit.response.response import ComplexArray, MeasuredResponse
from vibrident.fit.response.transform import MOST_KEPT, about_mean, hann, power_of, transforms

LINES_IN_BAND = 6
#: Part of the lines under a window that are independent.
INDEPENDENT = 0.5
#: Above this probability under independence, the response and the reference of a record have nothing in common.
BY_CHANCE = 0.1
#: Chance that two channels with nothing in common show as much.
SURE = 1e-4
#: Fewer lines do not tell the noise of a band beside its response.
FEWEST_LINES = 3
BANDS_PER_OCTAVE = 12
#: The noise of a wider band is estimated from every second, third … line, to save memory.
MOST_LINES = 4096
#: A band counts when its excitation per line is above this part of the strongest band's.
LEAST_POWER = 1e-5
#: … and where the channels have something in common, of such bands at most this part by chance …
FALSE_BANDS = 0.01
#: … unless that leaves a record fewer bands than this.
FEWEST_BANDS = 6
#: A displacement holds so much more at low frequencies that these would leak over all others; differences of both
#: channels, sample by sample, are level and have the same ratio.
DIFFERENCES: dict[Quantity, int] = {"velocity": 1, "displacement": 2}


def measure_bands(
    records: Sequence[Record], quantity: Quantity = "acceleration"
) -> MeasuredResponse | None:
    """Banded response of records with a reference of this quantity; None if no band holds excitation."""
    level = [
        (index, _differenced(r, DIFFERENCES.get(quantity, 0)))
        for index, r in enumerate(records)
        if r.reference is not None
    ]
    rates = {record.sampling_rate_hz for _, record in level}
    found = [
        part
        for rate in rates
        for part in _at_one_delay([one for one in level if one[1].sampling_rate_hz == rate])
    ]
    parts = [part for _, part in sorted(found, key=lambda one: (one[0], one[1].frequency_hz[0]))]
    return MeasuredResponse.join(parts) if parts else None


def _at_one_delay(records: Sequence[tuple[int, Record]]) -> list[tuple[int, MeasuredResponse]]:
    """The bands of all records of one sampling rate, by their index, at the delay with which most agrees.

    One sensor has one delay. It is read from all records together, as they are and whitened: free motion hides it from
    the former, noise at high frequencies from the latter.
    """
    filtered = [whitened(record) for _, record in records]
    longest = max(record.samples for _, record in records)
    delays = {bulk_delay((record for _, record in records), longest), bulk_delay(filtered, longest)}
    looks = []
    for late in sorted(delays, key=abs):
        plain = _coherent([_Look.at(record, late) for _, record in records])
        white = _coherent(
            [None if record is None else _Look.at(record, late) for record in filtered]
        )
        own = zip(records, plain, white, strict=True)
        found = [(index, look) for (index, _), *both in own for look in _clearer(both)]
        looks.append((sum(look.whole for _, look in found), late, found))
    _, late, found = max(looks, key=lambda one: one[0])
    return [(index, look.bands(index, late)) for index, look in found]


def _coherent(looks: Sequence[_Look | None]) -> list[_Look | None]:
    """The looks with the bands in which the channels have something in common; with all where these are too few.

    What of the reference does not show in the response is its own noise, beyond the excitation's band. A band is tested
    by all records that have it: without motion the evidence of each is exponential.
    """
    found = list(looks)
    for samples, edges in {
        look.record.samples: len(look.edges) for look in looks if look is not None
    }.items():
        some = {
            k: look
            for k, look in enumerate(looks)
            if look is not None and look.record.samples == samples
        }
        evidence, records = np.zeros((2, edges - 1))
        for look in some.values():
            evidence[look.keep] += look.evidence
            records[look.keep] += 1.0
        tested, shown = np.flatnonzero(records), np.zeros(len(records), dtype=bool)
        chance = [
            gamma_tail(*pair)
            for pair in zip(records[tested].tolist(), evidence[tested].tolist(), strict=True)
        ]
        shown[tested] = _significant(np.array(chance))
        for k, look in some.items():
            own = shown[look.keep]
            found[k] = look.only(own) if np.count_nonzero(own) >= FEWEST_BANDS else look
    return found


def _significant(chance: FloatArray) -> BoolArray:
    """The tests that noise does not explain, at most FALSE_BANDS of them wrongly (Benjamini & Hochberg 1995)."""
    order = np.sort(chance)
    passed = order[order <= FALSE_BANDS * np.arange(1, order.size + 1) / order.size]
    return chance <= np.max(passed, initial=-1.0)


def _clearer(both: Sequence[_Look | None]) -> list[_Look]:
    """The bands of a record as it is, or whitened: of the look in which the two channels agree more.

    The other look has bands in which they agree where they do not in this one: whitening hides frequencies below those
    that it raises. These are taken where they show, by no chance, that the channels have something in common.
    """
    looks = sorted((look for look in both if look is not None), key=lambda look: -look.whole)
    if len(looks) < 2:
        return looks
    first, second = looks
    dropped = np.ones(len(first.edges) - 1, dtype=bool)
    dropped[first.keep] = False
    there = np.clip(np.searchsorted(first.edges_hz, second.middle_hz) - 1, 0, dropped.size - 1)
    others = second.only(dropped[there])
    return [first, others] if others.sure else [first]


def _evidence_of_motion(coherence: FloatArray, lines: FloatArray) -> FloatArray:
    """−(n − 1) log(1 − γ²) of each band of so many lines, shape (bands,)."""
    freedom = np.maximum(INDEPENDENT * lines - 1.0, 1.0)
    return -freedom * np.log(1.0 - np.clip(coherence, 0.0, 1.0 - 1e-12))


def _coherence(bands: MeasuredResponse) -> FloatArray:
    """γ² of each band, shape (bands,)."""
    total = 2.0 * np.sum(np.abs(bands.line_response) ** 2 * bands.line_weight, axis=1)
    return np.abs(bands.response) ** 2 / np.maximum(total, np.finfo(float).tiny)


def uncorrelated_records(bands: MeasuredResponse) -> list[int]:
    """Records whose response has nothing in common with their reference: what ``bands.record`` calls them.

    Of n lines without anything in common, 1 − γ² is below x with the chance 1 − x^(n − 1) (γ² the coherence), so that
    Σ −(n − 1) log(1 − γ²) over the bands is a sum of exponentials.
    """
    share = _coherence(bands)
    found = []
    for record in distinct(bands.record).tolist():
        own = bands.record == record
        statistic = float(
            np.sum(_evidence_of_motion(share[own], np.sum(bands.line_weight[own], axis=1)))
        )
        if gamma_tail(float(own.sum()), statistic) > BY_CHANCE:
            found.append(int(record))
    return found


@functools.lru_cache(maxsize=16)
def band_edges(samples: int, rate: float) -> FloatArray:
    """First bin of each band and the end of the last: log-spaced, at least LINES_IN_BAND lines wide; ints as floats."""
    edges, last = [1], int(0.45 * samples)
    while edges[-1] < last:
        edges.append(max(edges[-1] + LINES_IN_BAND, int(edges[-1] * 2 ** (1 / BANDS_PER_OCTAVE))))
    edges[-1] = max(last, edges[-2] + 1) if len(edges) > 1 else last
    if len(edges) > 2 and edges[-1] - edges[-2] < FEWEST_LINES:
        del edges[-2]  # what is left over belongs to the band below
    return np.array(edges, dtype=float)


@dataclass(frozen=True, eq=False)
class _Look:
    """A record with its response moved back by some samples, and the bands that count.

    Attributes:
        record: as moved.
        spectrum: of reference and response; None for a long record, where they are made again.
        edges: of all bands, in lines, shape (all + 1,).
        keep: the bands that count, shape (bands,).
        total: Σ|X|² of these, shape (bands,).
        cross: Σ Y X* of these, shape (bands,).
        evidence: that the channels have something in common, shape (bands,).
    """

    record: Record
    spectrum: tuple[ComplexArray, ComplexArray] | None
    edges: NDArray[np.int_]
    keep: NDArray[np.int_]
    total: FloatArray
    cross: ComplexArray
    evidence: FloatArray

    @property
    def whole(self) -> float:
        """Evidence of all bands."""
        return float(np.sum(self.evidence))

    @property
    def sure(self) -> bool:
        """Whether the channels have something in common by no chance, in bands that were kept for that."""
        return bool(self.keep.size) and gamma_tail(float(self.keep.size), self.whole) < SURE

    @property
    def edges_hz(self) -> FloatArray:
        """Of all bands, shape (all + 1,)."""
        return np.asarray(
            self.edges * (self.record.sampling_rate_hz / self.record.samples), dtype=float
        )

    @property
    def middle_hz(self) -> FloatArray:
        """Of the bands that count, shape (bands,)."""
        return 0.5 * (self.edges_hz[self.keep] + self.edges_hz[self.keep + 1])

    def only(self, some: BoolArray) -> _Look:
        """With some of the bands that count, shape (bands,)."""
        keep, total, cross, evidence = (
            self.keep[some],
            self.total[some],
            self.cross[some],
            self.evidence[some],
        )
        return replace(self, keep=keep, total=total, cross=cross, evidence=evidence)

    @classmethod
    def at(cls, whole: Record, late: int) -> _Look | None:
        """Of a record whose response comes so many samples late; None if no band holds excitation."""
        record = aligned(whole, late)
        reference, response = _spectra(record)
        edges = band_edges(record.samples, record.sampling_rate_hz).astype(int)
        total, answered, cross = _sums(reference, response, edges)
        both, counts = total * answered, np.diff(edges)
        coherence = np.divide(power_of(cross), both, out=np.zeros_like(both), where=both > 0)
        keep = np.flatnonzero(total / counts > LEAST_POWER * np.max(total / counts))
        if not keep.size:
            return None
        for band in keep[counts[keep] > MOST_LINES].tolist():  # by the lines that are kept
            some = response[edges[band] : edges[band + 1] : _stride(counts[band])]
            coherence[band] = power_of(cross[band]) / max(
                float(np.sum(power_of(some))) * total[band], TINY
            )
        lines = -(-counts[keep] // _stride(counts[keep]))
        evidence = _evidence_of_motion(coherence[keep], lines)
        kept = (reference, response) if record.samples <= MOST_KEPT else None
        return cls(record, kept, edges, keep, total[keep], cross[keep], evidence)

    def bands(self, index: int, late: int) -> MeasuredResponse:
        """The response over the bands, turned back by so many samples."""
        n, rate, counts = (
            self.record.samples,
            self.record.sampling_rate_hz,
            np.diff(self.edges)[self.keep],
        )
        reference, response = self.spectrum or _spectra(self.record)
        first, end = self.edges[self.keep], self.edges[self.keep + 1]
        moments = power_of(reference[: self.edges[-1]])
        moments *= np.arange(moments.size)
        frequency = np.add.reduceat(moments, self.edges[:-1])[self.keep] / self.total * rate / n
        place = (
            first[:, None] + np.arange(min(np.max(counts), MOST_LINES)) * _stride(counts)[:, None]
        )
        there = place < end[:, None]
        place = np.where(there, place, 0)
        back = np.exp(
            -2j * np.pi * frequency * (late / rate)
        )  # lines turn as if all had the phase of their centre
        return MeasuredResponse(
            frequency,
            np.sqrt(self.total).astype(complex),
            self.cross / np.sqrt(self.total) * back,
            np.where(there, place * (rate / n), 1.0),
            np.where(there, reference[place] / np.sqrt(2.0), 0.0),
            np.where(there, response[place] / np.sqrt(2.0), 0.0) * back[:, None],
            there.astype(float),
            np.maximum(2.0 * counts - 2.0, 1.0),
            np.full(self.keep.size, index),
            np.zeros((self.keep.size, 2)),
        )


def _stride(count: Any) -> Any:
    """Every so many of a band's lines are kept."""
    return -(-count // MOST_LINES)


def _spectra(record: Record) -> tuple[ComplexArray, ComplexArray]:
    """Spectra of reference and response under a window."""
    assert record.reference is not None
    window = hann(record.samples)
    window = record.mask.astype(float) if record.excitation == "shock" else window * record.mask
    reference, response = windowed_spectra((record.reference, record.response), record.mask, window)
    return reference, response


def _differenced(record: Record, times: int) -> Record:
    """The record with both channels differenced so often; their ratio stays."""
    if times == 0 or record.samples <= LINES_IN_BAND + times:
        return record
    assert record.reference is not None
    used = record.mask & record.reference_mask
    for _ in range(times):
        used = used[1:] & used[:-1]
    reference, response = (
        np.diff(values, n=times) for values in (record.reference, record.response)
    )
    return replace(record, reference=reference, response=response, valid=used, reference_valid=None)


def windowed_spectra(
    channels: Sequence[FloatArray], mask: BoolArray, window: FloatArray
) -> ComplexArray:
    """Amplitudes of windowed channels without their means, shape (channels, samples // 2 + 1)."""
    series = [about_mean(values, mask) for values in channels]
    for values in series:
        values *= window
    spectra = transforms(series)
    spectra *= 2.0 / (np.sum(window) or 1.0)  # a long delay may leave no samples
    return spectra


def _sums(
    reference: ComplexArray, response: ComplexArray, edges: NDArray[np.int_]
) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """Σ|X|², Σ|Y|² and Σ Y X* over the lines of each band."""
    products = (power_of(reference), power_of(response), response * np.conj(reference))
    first, second, both = (np.add.reduceat(lines[: edges[-1]], edges[:-1]) for lines in products)
    return first, second, both

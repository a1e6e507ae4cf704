"""Response over narrow bands for motion that is not a sine: sweeps, random, multisine, shock.

H = Σ Y X* / Σ |X|² over the spectral lines of a band (the H1 estimate; Bendat & Piersol 2010, sec.
6.1), for bands that hold enough of the excitation. Start values and pictures come from it, never
the identified parameters.
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
from vibrident.fit.response.alignment import TINY, Channels, aligned, bulk_delay, whitened
from vibrident.fit.response.response import ComplexArray, MeasuredResponse
from vibrident.fit.response.transform import (
    MAX_CACHED_SAMPLES,
    about_mean,
    band_sums,
    hann,
    power_of,
    transforms,
)

LINES_IN_BAND = 6
#: Fraction of the lines under a window that are independent.
INDEPENDENT_FRACTION = 0.5
#: Above this probability under independence, response and reference of a record are uncorrelated.
MAX_CHANCE_OF_RECORD = 0.1
#: Largest chance of such evidence from two uncorrelated channels.
MAX_CHANCE_OF_BANDS = 1e-4
#: Fewest lines that show the noise of a band beside its response.
MIN_LINES = 3
BANDS_PER_OCTAVE = 12
#: The noise of a wider band is estimated from every second, third … line, to save memory.
MAX_LINES = 4096
#: A band counts when its excitation per line exceeds this fraction of the strongest one …
MIN_RELATIVE_POWER = 1e-5
#: … and where the channels are correlated: this fraction of such bands may be so by chance …
MAX_FALSE_FRACTION = 0.01
#: … unless that leaves a record fewer bands than this.
MIN_BANDS = 6
#: Samples of short records that are summed side by side: what stays in the cache of the processor.
MAX_SAMPLES_AT_ONCE = 1 << 17
#: A displacement is so strong at low frequencies that these would leak over all others. Differences
#: of both channels, sample by sample, are level and have the same ratio.
DIFFERENCES: dict[Quantity, int] = {"velocity": 1, "displacement": 2}


def measure_bands(
    records: Sequence[Record], quantity: Quantity = "acceleration"
) -> MeasuredResponse | None:
    """Return the banded response of records with a reference, or None if no band holds excitation.

    Args:
        records: those without a reference are left out.
        quantity: of the reference.
    """
    level = [
        (index, _differenced(Channels.from_record(r), DIFFERENCES.get(quantity, 0)))
        for index, r in enumerate(records)
        if r.reference is not None
    ]
    rates = {channels.rate_hz for _, channels in level}
    indexed = [
        pair
        for rate in rates
        for pair in _at_one_delay([entry for entry in level if entry[1].rate_hz == rate])
    ]
    responses = [
        bands for _, bands in sorted(indexed, key=lambda pair: (pair[0], pair[1].frequency_hz[0]))
    ]
    return MeasuredResponse.join(responses) if responses else None


def _at_one_delay(entries: Sequence[tuple[int, Channels]]) -> list[tuple[int, MeasuredResponse]]:
    """Return index and bands of all records of one sampling rate, at the delay of most evidence.

    One sensor has one delay. It is estimated from all records together, as they are and whitened:
    free motion hides it from the former, noise at high frequencies from the latter.
    """
    indices, measured = zip(*entries, strict=True)
    filtered = [whitened(channels) for channels in measured]
    longest = max(channels.samples for channels in measured)
    delays = {bulk_delay(channels, longest) for channels in (measured, filtered)}
    candidates = []
    for delay in sorted(delays, key=abs):
        plain, white = (_coherent(_sums_at(channels, delay)) for channels in (measured, filtered))
        pairs = zip(indices, plain, white, strict=True)
        clearest = [(index, sums) for index, *pair in pairs for sums in _clearer(pair)]
        total_evidence = sum(sums.total_evidence for _, sums in clearest)
        candidates.append((total_evidence, delay, clearest))
    _, delay, clearest = max(candidates, key=lambda candidate: candidate[0])
    return [(index, sums.bands(index, delay)) for index, sums in clearest]


def _sums_at(channels: Sequence[Channels | None], delay: int) -> list[_BandSums | None]:
    """Return the sums of each record with its response moved back, None where no band counts.

    Records of one length are summed side by side.
    """
    moved = {
        number: aligned(record, delay)
        for number, record in enumerate(channels)
        if record is not None
    }
    sums = dict[int, _BandSums | None]()
    for samples in {record.samples for record in moved.values()}:
        numbers = [number for number in moved if moved[number].samples == samples]
        count = max(MAX_SAMPLES_AT_ONCE // samples, 1)
        for first in range(0, len(numbers), count):
            batch = numbers[first : first + count]
            of_batch = _BandSums.of_batch([moved[number] for number in batch])
            sums |= zip(batch, of_batch, strict=True)
    return [sums.get(number) for number in range(len(channels))]


def _coherent(sums_of_records: Sequence[_BandSums | None]) -> list[_BandSums | None]:
    """Return the sums of the coherent bands, or of all bands where these are too few.

    What of the reference does not show in the response is its own noise, beyond the band of the
    excitation. A band is tested on all records that have it: without motion the evidence of each is
    exponentially distributed.
    """
    coherent = list(sums_of_records)
    for samples, edges in {
        sums.channels.samples: len(sums.edges) for sums in sums_of_records if sums is not None
    }.items():
        same_length = {
            k: sums
            for k, sums in enumerate(sums_of_records)
            if sums is not None and sums.channels.samples == samples
        }
        evidence, counts = np.zeros((2, edges - 1))
        for sums in same_length.values():
            evidence[sums.keep] += sums.evidence
            counts[sums.keep] += 1.0
        tested = np.flatnonzero(counts)
        significant = np.zeros(len(counts), dtype=bool)
        chances = [
            gamma_tail(*pair)
            for pair in zip(counts[tested].tolist(), evidence[tested].tolist(), strict=True)
        ]
        significant[tested] = _significant(np.array(chances))
        for k, sums in same_length.items():
            selected = significant[sums.keep]
            enough = np.count_nonzero(selected) >= MIN_BANDS
            coherent[k] = sums.only(selected) if enough else sums
    return coherent


def _significant(chance: FloatArray) -> BoolArray:
    """Return which tests noise does not explain, by their chance, shape (tests,).

    At most the fraction MAX_FALSE_FRACTION of them is wrong (Benjamini & Hochberg 1995).
    """
    order = np.sort(chance)
    passed = order[order <= MAX_FALSE_FRACTION * np.arange(1, order.size + 1) / order.size]
    return chance <= np.max(passed, initial=-1.0)


def _clearer(pair: Sequence[_BandSums | None]) -> list[_BandSums]:
    """Return the bands of a record as it is or whitened, whichever shows more evidence of motion.

    The other has bands in which the channels are correlated where they are not in this one:
    whitening hides frequencies below those that it raises. These are added where that is
    significant.
    """
    ordered = sorted(
        (sums for sums in pair if sums is not None), key=lambda sums: -sums.total_evidence
    )
    if len(ordered) < 2:
        return ordered
    first, second = ordered
    dropped = np.ones(len(first.edges) - 1, dtype=bool)
    dropped[first.keep] = False
    bands = np.clip(np.searchsorted(first.edges_hz, second.middle_hz) - 1, 0, dropped.size - 1)
    additional = second.only(dropped[bands])
    return [first, additional] if additional.significant else [first]


def _evidence_of_motion(coherence: FloatArray, lines: FloatArray) -> FloatArray:
    """Return −(n − 1) log(1 − γ²) of each band, shape (bands,).

    Args:
        coherence: γ², shape (bands,).
        lines: n of each, shape (bands,).
    """
    freedom = np.maximum(INDEPENDENT_FRACTION * lines - 1.0, 1.0)
    return -freedom * np.log(1.0 - np.clip(coherence, 0.0, 1.0 - 1e-12))


def _coherence(bands: MeasuredResponse) -> FloatArray:
    """Return γ² of each band, shape (bands,)."""
    total = 2.0 * np.sum(np.abs(bands.line_response) ** 2 * bands.line_weight, axis=1)
    return np.abs(bands.response) ** 2 / np.maximum(total, np.finfo(float).tiny)


def uncorrelated_records(
    bands: MeasuredResponse, max_chance: float = MAX_CHANCE_OF_RECORD
) -> list[int]:
    """Return the records whose response and reference are uncorrelated, by index.

    These are as correlated as others with a chance above ``max_chance``.

    Of n lines without correlation, 1 − γ² is below x with the chance 1 − x^(n − 1) (γ² the
    coherence), so that Σ −(n − 1) log(1 − γ²) over the bands is a sum of exponentials.
    """
    coherence = _coherence(bands)
    uncorrelated = []
    for record in distinct(bands.record).tolist():
        of_record = bands.record == record
        lines = np.sum(bands.line_weight[of_record], axis=1)
        statistic = float(np.sum(_evidence_of_motion(coherence[of_record], lines)))
        if gamma_tail(float(of_record.sum()), statistic) > max_chance:
            uncorrelated.append(int(record))
    return uncorrelated


@functools.lru_cache(maxsize=16)
def band_edges(samples: int, rate: float) -> FloatArray:
    """Return the first bin of each band and the end of the last; integers as floats.

    Bands are log-spaced, and at least LINES_IN_BAND lines wide.
    """
    edges = [1]
    last = int(0.45 * samples)
    while edges[-1] < last:
        edges.append(max(edges[-1] + LINES_IN_BAND, int(edges[-1] * 2 ** (1 / BANDS_PER_OCTAVE))))
    edges[-1] = max(last, edges[-2] + 1) if len(edges) > 1 else last
    if len(edges) > 2 and edges[-1] - edges[-2] < MIN_LINES:
        del edges[-2]  # the remainder belongs to the band below
    return np.array(edges, dtype=float)


@dataclass(frozen=True, eq=False)
class _BandSums:
    """Sums over the bands of a record whose response is moved back by its delay.

    Attributes:
        channels: as moved.
        spectrum: of reference and response, shape (2, lines); None for a long record, where they
            are computed again.
        edges: of all bands, in lines, shape (all + 1,).
        keep: indices of the bands that count, shape (bands,).
        total: Σ|X|² of these, shape (bands,).
        cross: Σ Y X* of these, shape (bands,).
        evidence: that the channels are correlated, shape (bands,).
    """

    channels: Channels
    spectrum: ComplexArray | None
    edges: NDArray[np.int_]
    keep: NDArray[np.int_]
    total: FloatArray
    cross: ComplexArray
    evidence: FloatArray

    @property
    def total_evidence(self) -> float:
        """Return the evidence of all bands together."""
        return float(np.sum(self.evidence))

    @property
    def significant(self) -> bool:
        """Return whether the channels are correlated by no chance, in bands selected for that."""
        return (
            bool(self.keep.size)
            and gamma_tail(float(self.keep.size), self.total_evidence) < MAX_CHANCE_OF_BANDS
        )

    @property
    def edges_hz(self) -> FloatArray:
        """Return the edges of all bands in Hz, shape (all + 1,)."""
        return np.asarray(self.edges * (self.channels.rate_hz / self.channels.samples), dtype=float)

    @property
    def middle_hz(self) -> FloatArray:
        """Return the middles of the bands that count in Hz, shape (bands,)."""
        return 0.5 * (self.edges_hz[self.keep] + self.edges_hz[self.keep + 1])

    def only(self, selected: BoolArray) -> _BandSums:
        """Return the sums of the bands that count and are ``selected``, shape (bands,)."""
        return replace(
            self,
            keep=self.keep[selected],
            total=self.total[selected],
            cross=self.cross[selected],
            evidence=self.evidence[selected],
        )

    @classmethod
    def of_batch(cls, batch: Sequence[Channels]) -> list[_BandSums | None]:
        """Return the sums of records of one length, None of one without a band with excitation."""
        samples = batch[0].samples
        spectra = _spectra(batch)
        edges = band_edges(samples, batch[0].rate_hz).astype(int)
        total, response_total, cross = _sums(spectra[:, 0], spectra[:, 1], edges)
        product = total * response_total
        counts = np.diff(edges)
        coherence = np.divide(
            power_of(cross), product, out=np.zeros_like(product), where=product > 0
        )
        power = total / counts
        counting = power > MIN_RELATIVE_POWER * np.max(power, axis=1, keepdims=True)
        for row, band in np.argwhere(counting & (counts > MAX_LINES)).tolist():
            sampled = spectra[row, 1, edges[band] : edges[band + 1] : _stride(counts[band])]
            coherence[row, band] = power_of(cross[row, band]) / max(
                float(np.sum(power_of(sampled))) * total[row, band], TINY
            )
        evidence = _evidence_of_motion(coherence, -(-counts // _stride(counts)))
        sums = list[_BandSums | None]()
        for row, channels in enumerate(batch):
            keep = np.flatnonzero(counting[row])
            spectrum = spectra[row] if samples <= MAX_CACHED_SAMPLES else None
            of_record = cls(
                channels,
                spectrum,
                edges,
                keep,
                total[row, keep],
                cross[row, keep],
                evidence[row, keep],
            )
            sums.append(of_record if keep.size else None)
        return sums

    def bands(self, index: int, delay: int) -> MeasuredResponse:
        """Return the response over the bands of the record ``index``, with its delay put back."""
        n = self.channels.samples
        rate = self.channels.rate_hz
        counts = np.diff(self.edges)[self.keep]
        spectrum = _spectra([self.channels])[0] if self.spectrum is None else self.spectrum
        reference, response = spectrum
        first = self.edges[self.keep]
        end = self.edges[self.keep + 1]
        moments = power_of(reference)
        moments *= np.arange(moments.size)
        frequency = band_sums(moments, self.edges)[self.keep] / self.total * rate / n
        lines = (
            first[:, None] + np.arange(min(np.max(counts), MAX_LINES)) * _stride(counts)[:, None]
        )
        exists = lines < end[:, None]
        lines = np.where(exists, lines, 0)
        # All lines of a band turn by the phase at its centre.
        rotation = np.exp(-2j * np.pi * frequency * (delay / rate))
        return MeasuredResponse(
            frequency,
            np.sqrt(self.total).astype(complex),
            self.cross / np.sqrt(self.total) * rotation,
            np.where(exists, lines * (rate / n), 1.0),
            np.where(exists, reference[lines] / np.sqrt(2.0), 0.0),
            np.where(exists, response[lines] / np.sqrt(2.0), 0.0) * rotation[:, None],
            exists.astype(float),
            np.maximum(2.0 * counts - 2.0, 1.0),
            np.full(self.keep.size, index),
            np.zeros((self.keep.size, 2)),
        )


def _stride(count: Any) -> Any:
    """Return k where a band of so many lines is represented by each k-th of them."""
    return -(-count // MAX_LINES)


def _spectra(batch: Sequence[Channels]) -> ComplexArray:
    """Return amplitudes of the windowed channels about their means, shape (R, 2, lines).

    The records are of one length.
    """
    samples = batch[0].samples
    windowed = np.empty((len(batch), 2, samples))
    sizes = list[float]()
    for rows, channels in zip(windowed, batch, strict=True):
        window = np.ones(samples) if channels.is_shock else hann(samples)
        window = window if channels.used.all() else window * channels.used
        for row, values in zip(rows, (channels.reference, channels.response), strict=True):
            np.multiply(about_mean(values, channels.used), window, out=row)
        sizes.append(float(np.sum(window)) or 1.0)  # a long delay may leave no samples
    spectra = transforms(windowed.reshape(-1, samples)).reshape(len(batch), 2, -1)
    spectra *= 2.0 / np.array(sizes)[:, None, None]
    return spectra


def _differenced(channels: Channels, times: int) -> Channels:
    """Return both channels differenced so often, which keeps their ratio."""
    if times == 0 or channels.samples <= LINES_IN_BAND + times:
        return channels
    used = channels.used & channels.reference_used
    for _ in range(times):
        used = used[1:] & used[:-1]
    reference, response = (
        np.diff(values, n=times) for values in (channels.reference, channels.response)
    )
    return channels.changed(reference, response, used)


def _sums(
    reference: ComplexArray, response: ComplexArray, edges: NDArray[np.int_]
) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """Return Σ|X|², Σ|Y|² and Σ Y X* over the lines of each band, each of shape (R, bands)."""
    products = (power_of(reference), power_of(response), response * np.conj(reference))
    reference_power, response_power, cross = (band_sums(lines, edges) for lines in products)
    return reference_power, response_power, cross

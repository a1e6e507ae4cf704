"""Response over narrow bands for motion that is not a sine: sweeps, random, multisine, shock.

H = Σ Y X* / Σ |X|² over the spectral lines of a band (the H1 estimate; Bendat & Piersol 2010, sec. 6.1), for bands
that hold enough of the excitation. Start values and pictures come from it, never the identified parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.measure.alignment import aligned, bulk_delay, whitened
from vibrident.measure.lines import hann, power_of
from vibrident.measure.response import ComplexArray, MeasuredResponse
from vibrident.records import BoolArray, FloatArray, Quantity, Record
from vibrident.tails import gamma_tail

LINES_IN_BAND = 6
#: Part of the lines under a window that are independent.
INDEPENDENT = 0.5
#: Above this probability under independence, the response and the reference of a record have nothing in common.
BY_CHANCE = 0.1
#: Fewer lines do not tell the noise of a band beside its response.
FEWEST_LINES = 3
BANDS_PER_OCTAVE = 12
#: The noise of a wider band is estimated from every second, third … line, to save memory.
MOST_LINES = 4096
#: A band counts when its excitation per line is above this part of the strongest band's.
LEAST_POWER = 1e-5
#: … and where at least this part of the response is coherent with it …
LEAST_COHERENCE = 0.4
#: … unless that leaves fewer bands than this.
FEWEST_BANDS = 6
#: A displacement holds so much more at low frequencies that these would leak over all others; differences of both
#: channels, sample by sample, are level and have the same ratio.
DIFFERENCES: dict[Quantity, int] = {"velocity": 1, "displacement": 2}


def measure_bands(records: Sequence[Record], quantity: Quantity = "acceleration") -> MeasuredResponse | None:
    """Banded response of records with a reference of this quantity; None if no band holds excitation."""
    level = [
        (index, _differenced(r, DIFFERENCES.get(quantity, 0)))
        for index, r in enumerate(records)
        if r.reference is not None
    ]
    rates = {record.sampling_rate_hz for _, record in level}
    found = [
        part for rate in rates for part in _at_one_delay([one for one in level if one[1].sampling_rate_hz == rate])
    ]
    parts = [part for _, part in sorted(found, key=lambda one: one[0])]
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
        found = [
            (index, part)
            for (index, record), white in zip(records, filtered, strict=True)
            if (part := _clearer(index, record, white, late)) is not None
        ]
        looks.append((sum(float(np.sum(_evidence_of_motion(part))) for _, part in found), found))
    return max(looks, key=lambda look: look[0])[1]


def _clearer(index: int, record: Record, white: Record | None, late: int) -> MeasuredResponse | None:
    """The bands of a record as it is, or whitened: where the two channels agree more."""
    looks = [_measure(index, one, late) for one in (record, white) if one is not None]
    found = [look for look in looks if look is not None]
    return max(found, key=lambda look: float(np.sum(_evidence_of_motion(look))), default=None)


def _evidence_of_motion(bands: MeasuredResponse, least: float = 0.0) -> FloatArray:
    """−(n − 1) log(1 − γ²) of each band, counted from the coherence ``least``, shape (bands,)."""
    lines = np.sum(bands.line_weight, axis=1)
    freedom = np.maximum(INDEPENDENT * lines - 1.0, 1.0)
    apart = 1.0 - np.clip(_coherence(bands), 0.0, 1.0 - 1e-12)
    return -freedom * np.log(np.minimum(apart / (1.0 - least), 1.0))


def _coherence(bands: MeasuredResponse) -> FloatArray:
    """γ² of each band, shape (bands,)."""
    total = 2.0 * np.sum(np.abs(bands.line_response) ** 2 * bands.line_weight, axis=1)
    return np.abs(bands.response) ** 2 / np.maximum(total, np.finfo(float).tiny)


def uncorrelated_records(bands: MeasuredResponse) -> list[int]:
    """Records whose response has nothing in common with their reference: what ``bands.record`` calls them.

    Of n lines without anything in common, 1 − γ² is below x with the chance 1 − x^(n − 1) (γ² the coherence), so that
    Σ −(n − 1) log(1 − γ²) over the bands is a sum of exponentials. Where only coherent bands were kept, it counts from
    there on.
    """
    share = _coherence(bands)
    found = []
    for record in np.unique(bands.record).tolist():
        own = bands.record == record
        least = LEAST_COHERENCE if np.min(share[own]) > LEAST_COHERENCE and own.sum() >= FEWEST_BANDS else 0.0
        statistic = float(np.sum(_evidence_of_motion(bands, least)[own]))
        if gamma_tail(float(own.sum()), statistic) > BY_CHANCE:
            found.append(int(record))
    return found


def band_edges(samples: int, rate: float) -> FloatArray:
    """First bin of each band and the end of the last: log-spaced, at least LINES_IN_BAND lines wide; ints as floats."""
    edges, last = [1], int(0.45 * samples)
    while edges[-1] < last:
        edges.append(max(edges[-1] + LINES_IN_BAND, int(edges[-1] * 2 ** (1 / BANDS_PER_OCTAVE))))
    edges[-1] = max(last, edges[-2] + 1) if len(edges) > 1 else last
    if len(edges) > 2 and edges[-1] - edges[-2] < FEWEST_LINES:
        del edges[-2]  # what is left over belongs to the band below
    return np.array(edges, dtype=float)


def _measure(index: int, whole: Record, late: int) -> MeasuredResponse | None:
    """The bands of a record whose response comes so many samples late."""
    record = aligned(whole, late)
    n, rate, mask = record.samples, record.sampling_rate_hz, record.mask
    assert record.reference is not None
    window = (np.ones(n) if record.excitation == "shock" else hann(n)) * mask
    spectrum = (windowed_spectrum(record.reference, mask, window), windowed_spectrum(record.response, mask, window))
    edges = band_edges(n, rate).astype(int)
    power, coherence = power_and_coherence(*spectrum, edges)
    excited = power > LEAST_POWER * power.max()
    # What of the reference does not show in the response is its own noise, beyond the excitation's band.
    keep = np.flatnonzero(excited & (coherence > LEAST_COHERENCE))
    if keep.size < FEWEST_BANDS:
        keep = np.flatnonzero(excited)
    if power.max() == 0 or keep.size == 0:
        return None
    counts = edges[keep + 1] - edges[keep]
    width = int(min(np.max(counts), MOST_LINES))
    shape = (keep.size, width)
    hz, x, y, weight = np.ones(shape), np.zeros(shape, complex), np.zeros(shape, complex), np.zeros(shape)
    frequency, reference, response = np.zeros(keep.size), np.zeros(keep.size, complex), np.zeros(keep.size, complex)
    for row, band in enumerate(keep):
        lines = slice(edges[band], edges[band + 1])
        bx, by = spectrum[0][lines], spectrum[1][lines]
        own = power_of(bx)
        total = own.sum()
        bins = np.arange(lines.start, lines.stop)
        frequency[row] = (bins @ own) / total * rate / n
        reference[row], response[row] = np.sqrt(total), np.vdot(bx, by) / np.sqrt(total)
        some = slice(None, None, -(-int(counts[row]) // MOST_LINES))
        bins = bins[some]
        hz[row, : bins.size], weight[row, : bins.size] = bins * rate / n, 1.0
        x[row, : bins.size], y[row, : bins.size] = bx[some] / np.sqrt(2), by[some] / np.sqrt(2)
    back = np.exp(-2j * np.pi * frequency * (late / whole.sampling_rate_hz))
    response *= back  # the lines turn with their band, as if all of it had the phase of its centre
    y *= back[:, None]
    freedom = np.maximum(2.0 * counts - 2.0, 1.0)
    owner = np.full(keep.size, index)
    return MeasuredResponse(frequency, reference, response, hz, x, y, weight, freedom, owner, np.zeros((keep.size, 2)))


def _differenced(record: Record, times: int) -> Record:
    """The record with both channels differenced so often; their ratio stays."""
    if times == 0 or record.samples <= LINES_IN_BAND + times:
        return record
    assert record.reference is not None
    used = record.mask & record.reference_mask
    for _ in range(times):
        used = used[1:] & used[:-1]
    reference, response = (np.diff(values, n=times) for values in (record.reference, record.response))
    return replace(record, reference=reference, response=response, valid=used, reference_valid=None)


def windowed_spectrum(values: FloatArray, mask: BoolArray, window: FloatArray) -> ComplexArray:
    """Amplitudes of a windowed channel without its mean, shape (samples // 2 + 1,)."""
    series = values - values[mask].mean()
    series *= window
    spectrum = np.asarray(fft.rfft(series), dtype=complex)
    spectrum *= 2.0
    spectrum /= np.sum(window)
    return spectrum


def power_and_coherence(
    reference: ComplexArray, response: ComplexArray, edges: NDArray[np.int_]
) -> tuple[FloatArray, FloatArray]:
    """Mean of |X|², and |Σ Y X*|²/(Σ|X|² Σ|Y|²), over the lines of each band."""

    def sums(lines: FloatArray | ComplexArray) -> np.ndarray:
        return np.add.reduceat(lines[: edges[-1]], edges[:-1])

    total = sums(power_of(reference)), sums(power_of(response))
    cross = power_of(sums(response * np.conj(reference)))
    both = total[0] * total[1]
    return total[0] / np.diff(edges), np.divide(cross, both, out=np.zeros_like(both), where=both > 0)

"""Response over narrow bands for motion that is not a sine: sweeps, random, multisine, shock.

H = Σ Y X* / Σ |X|² over the spectral lines of a band (the H1 estimate; Bendat & Piersol 2010, sec. 6.1), for bands
that hold enough of the excitation. Start values and pictures come from it, never the identified parameters.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.measure.alignment import MOST_CUT, aligned, bulk_delay, whitened
from vibrident.measure.lines import fast_below, hann, power_of
from vibrident.measure.response import LEAST_DEVIATION, ComplexArray, MeasuredResponse
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
#: Stretches of time, half of each the next one's too, that tell how noise changes.
STRETCHES = 15
#: Groups of the lines of a stretch.
GROUPS = 16
#: A group is without motion below this part of the residual's power.
STILL = 0.1
#: Fewer groups without motion tell nothing.
FEWEST_STILL = 3
#: A band counts when its excitation per line is above this part of the strongest band's.
LEAST_POWER = 1e-5
#: … and where at least this part of the response is coherent with it …
LEAST_COHERENCE = 0.4
#: … unless that leaves fewer bands than this.
FEWEST_BANDS = 6
#: A band of which less than this part stays when the ends are faded holds what leaks over from others, residual and
#: prediction alike: both begin and end in the middle of a motion.
OWN_POWER = 0.5
#: Part of the record that is faded at either end for this.
TAPER = 1.0 / 64.0
#: The ends leak where they could give more than this part of a line's power.
LEAKED = 0.1
#: A band is not used if noise of the reference makes up more than this part of the prediction.
MOST_SHARED = 0.3
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
    power, coherence = _power_and_coherence(*spectrum, edges)
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


def _power_and_coherence(
    reference: ComplexArray, response: ComplexArray, edges: NDArray[np.int_]
) -> tuple[FloatArray, FloatArray]:
    """Mean of |X|², and |Σ Y X*|²/(Σ|X|² Σ|Y|²), over the lines of each band."""

    def sums(lines: FloatArray | ComplexArray) -> np.ndarray:
        return np.add.reduceat(lines[: edges[-1]], edges[:-1])

    total = sums(power_of(reference)), sums(power_of(response))
    cross = power_of(sums(response * np.conj(reference)))
    both = total[0] * total[1]
    return total[0] / np.diff(edges), np.divide(cross, both, out=np.zeros_like(both), where=both > 0)


def coherent_remainder(
    record: Record,
    predicted: FloatArray,
    through: FloatArray | None = None,
    hum_hz: Sequence[float] = (),
    least: FloatArray | None = None,
) -> tuple[FloatArray, NDArray[np.complex128], FloatArray, FloatArray] | None:
    """What of a time residual is coherent with the predicted response, by narrow bands.

    With E and Ŷ the spectra of residual and prediction, ρ = Σ E Ŷ*/Σ |Ŷ|² is the relative error of the model's response
    in the band; the rest of E gives its deviation.

    Args:
        record: measured response.
        predicted: shape (samples,), NaN where it is not defined.
        through: variance, a sample, of noise of the reference channel itself, after the model's |H|², at
            the spectral lines of the record, shape (samples // 2 + 1,). Such noise is in E and in Ŷ, with opposite
            signs; it is allowed for, and bands that hold little else are left out.
        hum_hz: tones that are known not to come from the motion; they are removed from the residual.
        least: variance, a sample, that no noise is believed to be below, at the lines as ``through``.

    Returns:
        Frequencies, ρ, standard deviation of the real part of ρ, degrees of freedom; each of shape (bands,). None
        where no band holds enough of the response.
    """
    used = record.mask & np.isfinite(predicted)
    if used.sum() < 8 * LINES_IN_BAND:
        return None
    n, rate = record.samples, record.sampling_rate_hz
    # No window: white noise then has independent lines, whenever in the record the motion passes a band.
    left = _without(record.response - predicted, used, hum_hz, rate)
    error = _line_spectrum(left, used)
    spectrum = _line_spectrum(predicted - np.mean(predicted[used]), used)
    power = power_of(spectrum)
    own = _own_power(predicted - np.mean(predicted[used]), used, power)
    edges = band_edges(n, rate).astype(int)
    there, even = noise_where_bands_move(left, np.where(used, predicted, 0.0), used, edges)
    totals = np.add.reduceat(power[: edges[-1]], edges[:-1])
    strongest = float(np.max(totals / np.diff(edges)))
    own = np.add.reduceat(own[: edges[-1]], edges[:-1])
    rows, count, whole = [], float(used.sum()), float(np.mean(used))
    for (a, b), factor, total, stays in zip(
        itertools.pairwise(edges.tolist()), there.tolist(), totals.tolist(), own.tolist(), strict=True
    ):
        if total <= LEAST_POWER * strongest * (b - a) or stays < OWN_POWER * total:
            continue
        shared = 0.0 if through is None else float(count * np.sum(through[a:b]))
        if shared > MOST_SHARED * total:
            continue
        rho = (np.vdot(spectrum[a:b], error[a:b]) + shared) / total
        rest = float(np.sum(power_of(error[a:b] - (rho if shared == 0.0 else 0.0) * spectrum[a:b])))
        freedom = 2.0 * max((b - a) * whole * even - 1.0, 1.0)
        floor = LEAST_DEVIATION**2 * strongest * (b - a) / total  # relative to the record's strongest band
        if least is not None:
            floor = max(floor, float(count * np.mean(least[a:b])) / total / 2.0)
        # Of the band's noise so much is what ρ took: as much as there is while the band moves.
        variance = max(factor * rest / max(b - a - factor, 1.0) / total / 2.0, floor)
        if variance > 0.25:
            continue
        centre = float(np.arange(a, b) @ power[a:b]) / total * rate / n
        rows.append((centre, rho, np.sqrt(variance), freedom))
    if not rows:
        return None
    frequency, rho, deviation, freedom = zip(*rows, strict=True)
    return np.array(frequency), np.array(rho), np.array(deviation), np.array(freedom)


def noise_where_bands_move(
    left: FloatArray, motion: FloatArray, used: BoolArray, edges: NDArray[np.int_]
) -> tuple[FloatArray, float]:
    """Noise power while each band moves, over its mean over the record, and how even the noise is.

    A sweep passes a band in a moment; where noise grows within the record, that moment is not as noisy as the rest.
    The noise of a stretch of time is read where there is no motion, so that no misfit counts; one where all moves.

    Args:
        left: residual, zero where not used, shape (samples,).
        motion: predicted response, zero where not used, shape (samples,).
        used: shape (samples,).
        edges: first line of each band and the end of the last, shape (bands + 1,).

    Returns:
        The ratio, shape (bands,); and the independent lines among those of a band, as a part: lines of noise that
        changes with time are alike.
    """
    places = np.flatnonzero(used)
    samples, origin = int(places[-1] - places[0]) + 1, int(places[0])
    length = fast_below(2 * (samples // (STRETCHES + 1)), MOST_CUT)
    window, last = hann(length), int(0.45 * length)
    groups = np.unique(np.linspace(1, last, GROUPS + 1).astype(int))
    first = np.minimum(edges[:-1] * length // left.size, last - 1)
    end = np.maximum(-(-edges[1:] * length // left.size), first + 1)
    noise, moves = np.zeros((STRETCHES, len(groups) - 1)), np.zeros((STRETCHES, len(first)))
    still = np.zeros(noise.shape, dtype=bool)
    for row in range(STRETCHES):
        begin = origin + row * length // 2
        part = slice(begin, begin + length)
        own, moving = (power_of(np.asarray(fft.rfft(window * v[part]))) for v in (left, motion))
        noise[row] = np.add.reduceat(own[:last], groups[:-1]) / max(float(np.mean(used[part])), 1e-9)
        still[row] = np.add.reduceat(moving[:last], groups[:-1]) < STILL * noise[row]
        total = np.concatenate([[0.0], np.cumsum(moving)])
        moves[row] = total[end] - total[first]
    kept = still.all(axis=0)
    if kept.sum() < FEWEST_STILL:
        return np.ones(len(first)), 1.0
    level = np.median(noise[:, kept] / np.maximum(np.mean(noise[:, kept], axis=0), 1e-300), axis=1)
    # A stretch alone tells its noise to a quarter: over five it changes smoothly.
    level = np.convolve(np.pad(level, 2, mode="reflect", reflect_type="odd"), np.full(5, 0.2), mode="valid")
    level = np.maximum(level, 1e-300)
    shares = moves / np.maximum(np.sum(moves, axis=0), 1e-300)
    found = level @ shares / max(float(np.mean(level)), 1e-300)
    even = float(np.mean(level)) ** 2 / float(np.mean(level**2))
    return np.where(found > 0.0, np.clip(found, 1.0 / STRETCHES, STRETCHES), 1.0), even


def _own_power(series: FloatArray, used: BoolArray, power: FloatArray) -> FloatArray:
    """Power at the lines without what leaks over from others, shape (samples // 2 + 1,).

    What stays when the ends are faded; all of it where the ends are no step that could leak as much.
    """
    samples = series.size
    width = int(np.ceil(TAPER * samples))
    rise = np.sin(0.5 * np.pi * (np.arange(width) + 0.5) / width) ** 2
    faded = series * np.concatenate([rise, np.ones(samples - 2 * width), rise[::-1]])
    ends = series[np.flatnonzero(used)[[0, -1]]]
    steps = float(ends @ ends) / 4.0
    leaked = steps / np.sin(np.pi * np.maximum(np.arange(power.size), 1) / samples) ** 2
    return np.where(leaked < LEAKED * power, power, power_of(_line_spectrum(faded, used)))


def _without(residual: FloatArray, used: BoolArray, hum_hz: Sequence[float], rate: float) -> FloatArray:
    """The residual without these tones; each may drift a little in size and phase, as one of inexact frequency does."""
    if not len(hum_hz):
        return residual
    turn = np.linspace(-1.0, 1.0, len(residual))[used, None]
    angle = 2.0 * np.pi / rate * np.outer(np.flatnonzero(used), hum_hz)
    columns = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    columns = np.concatenate([columns, turn * columns], axis=1)
    amounts, *_ = np.linalg.lstsq(columns, residual[used], rcond=1e-9)
    left = residual.copy()
    left[used] -= columns @ amounts
    return left


def _line_spectrum(series: FloatArray, used: BoolArray) -> ComplexArray:
    """Transform of the samples that are used, shape (samples // 2 + 1,); the others of ``series`` are set to zero."""
    series[~used] = 0.0
    return np.asarray(fft.rfft(series), dtype=complex)

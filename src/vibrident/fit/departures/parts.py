"""The parts of a fit that the score tests look at: residual, motion and slopes, by their bins.

They are records at the bins of their transforms, sines beside an amplitude and a phase of their
own, or the samples of a nonlinear model. Their noise is not read yet.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.bins.exponentials import motion_bins
from vibrident.fit.departures.signals import (
    BAND_OVER_HIGHEST,
    MAX_SAMPLES_AT_ONCE,
    MIN_BINS,
    Part,
)
from vibrident.fit.descent.settle import InNoise
from vibrident.fit.descent.weighted_bins import MAX_LOST
from vibrident.fit.estimators import Estimate
from vibrident.fit.information import inverse_normal
from vibrident.fit.problem import Evidence
from vibrident.fit.problem.band import Band
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.terms import products
from vibrident.fit.response.tones import HARMONICS, free_exponents
from vibrident.fit.response.transform import MIN_SPECTRUM_SAMPLES, hann
from vibrident.fit.uncertainty.adequacy import Points
from vibrident.fit.uncertainty.linearised import Linearised

#: Longer records are looked at in pieces of so many samples: a limit of memory.
MAX_PIECE_SAMPLES = 1 << 16
MAX_PIECES = 4
#: Part of a piece in which its taper rises, and in which it falls.
TAPER = 0.1
#: Step of central differences of a nonlinear model's response, in its coordinates.
DIFFERENCE_STEP = 1e-5


def at_once(parts: Iterable[Part]) -> Iterator[list[Part]]:
    """Yield the parts in lists of as many as are worked on at once."""
    batch = list[Part]()
    samples = 0
    for part in parts:
        batch.append(part)
        samples += part.used.size
        if samples >= MAX_SAMPLES_AT_ONCE:
            yield batch
            batch = []
            samples = 0
    if batch:
        yield batch


def parts_of(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points | None
) -> Iterator[Part]:
    """Yield the parts of a fit of records, one after the other.

    Args:
        evidence: the data.
        estimate: the fit.
        predicted: response of each record, NaN where it is not defined.
        tones: of the sine records, in the order of the evidence's; None without any.
    """
    method = estimate.findings.method
    if method.is_exact and evidence.records:
        for part in _parts_by_estimate(evidence, estimate, predicted, tones):
            yield replace(part, is_band_limited=method.is_band_limited)


def _parts_by_estimate(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points | None
) -> Iterator[Part]:
    """Return the parts in the form in which the estimate fits them; as ``parts_of``."""
    if estimate.in_noise is not None:
        return _parts_of_segments(evidence, estimate, estimate.in_noise, predicted)
    if evidence.only_sines and evidence.model.is_linear and tones is not None:
        return _parts_of_sines(evidence, estimate, predicted, tones)
    return _parts_in_time(evidence, estimate, predicted)


def _parts_of_segments(
    evidence: Evidence, estimate: Estimate, in_noise: InNoise, predicted: Sequence[FloatArray]
) -> Iterator[Part]:
    """Yield the segments that the fit is of, at all bins that count."""
    tones = tones_of(evidence)
    segments = in_noise.band.problem.segments
    band = _band_of_tests(in_noise.band, bool(tones))
    is_noise_known = band is in_noise.band
    for place in in_noise.places(estimate.z, estimate.coordinates, at_all_bins_of=band):
        grid = place.group.grid
        if not grid.driven:
            continue
        for row, number in enumerate(place.group.segments):
            segment = segments[number]
            record = evidence.records[segment.record]
            noise = in_noise.weighting.of_segment(number)
            series = predicted[segment.record][segment.span]
            used = (
                np.ones(grid.samples, dtype=bool)
                if place.group.used is None
                else place.group.used[row]
            )
            if used.sum() < MIN_SPECTRUM_SAMPLES:
                continue
            # Gaps are filled in by the bins that count; the others say nothing of them.
            counted = slice(0, grid.last)
            residual = place.rows.residual[row, counted]
            jacobian = place.rows.jacobian[row, :, counted]
            jacobian = jacobian * estimate.coordinates.slopes(estimate.z)[:, None]
            if grid.samples <= MAX_PIECE_SAMPLES:
                signals = (
                    residual,
                    place.rows.predicted[row, counted],
                    np.where(used, series, 0.0),
                    jacobian,
                    place.rows.nuisances.of_row(row)[:, counted],
                )
                yield Part(
                    record,
                    segment.span,
                    used,
                    *signals,
                    turns=tones.get(segment.record),
                    known_noise=noise.spectrum_at(replace(grid, bins=grid.last))
                    if is_noise_known
                    else None,
                )
                continue
            pieces = _pieces(grid.samples)
            rows = [
                _cut_pieces(np.asarray(fft.irfft(lines, grid.samples)), pieces)
                for lines in (residual, *jacobian)
            ]
            motions = _cut_pieces(_about_mean(series, used), pieces)
            for piece, motion, piece_residual, *columns in zip(pieces, motions, *rows, strict=True):
                span = slice(segment.span.start + piece.start, segment.span.start + piece.stop)
                signals_of_piece = _SignalsInTime(
                    piece_residual, motion, np.array(columns), used[piece]
                )
                part = _part_in_time(
                    evidence,
                    estimate,
                    record,
                    span,
                    used[piece],
                    signals_of_piece.tapered(),
                    top_hz=grid.rate_hz / grid.samples * (grid.bins - 1),
                )
                if is_noise_known:
                    at_piece = replace(grid, samples=motion.size, bins=part.residual.size)
                    part = replace(part, known_noise=noise.spectrum_at(at_piece))
                yield part


def _band_of_tests(band: Band, with_sines: bool) -> Band:
    """Return the band of the score tests: the fit's, or all bins with hum beside the residual.

    Harmonics of sines lie above the fit's band: these are tested in noise that is read again.
    """
    return replace(band, top_hz=np.inf, tones=()) if with_sines else band


def _parts_of_sines(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points
) -> Iterator[Part]:
    """Yield each sine beside an amplitude and a phase of its own, which the points give the fit."""
    assert evidence.tones is not None
    count = len(tones.frequency_hz)
    linear = Linearised.from_points(
        estimate.coordinates,
        estimate.z,
        evidence.quantity,
        tones.frequency_hz,
        tones.measured,
        tones.relative_deviation,
    )
    inverse = inverse_normal(linear.matrix.T @ linear.matrix)
    # Records of one length without gaps have the same nuisance parameters.
    nuisances = dict[tuple[object, ...], ComplexArray]()
    for place, index in enumerate(evidence.tones.record.tolist()):
        record = evidence.records[index]
        series = predicted[index]
        turns = float(tones.frequency_hz[place]) / record.sampling_rate_hz
        pull = inverse @ (
            np.stack([linear.matrix[place], linear.matrix[count + place]], axis=1)
            * linear.weight[place]
        )
        for span in _spans(record, series):
            used = (record.mask & np.isfinite(series))[span]
            bins = min(_bins_of_sine(turns, used.size), used.size // 2 + 1)
            motion_used = np.where(used, series[span], 0.0)
            cosine, sine, mean = _amounts_of_tone(motion_used, used, turns)
            # The mean of what is no whole number of periods is not where it rests.
            motion = motion_used - mean * used
            residual = np.where(used, record.response[span] - series[span], 0.0)
            wave = motion_bins(_exponents([turns]), used, bins, growing=False)
            residual_bins, motion_at_bins = _bins_of((residual, motion), bins)
            alike = record.sampling_rate_hz, record.hum_hz, bins, used.tobytes()
            if alike not in nuisances:
                nuisances[alike] = _nuisance_bins(
                    evidence, estimate, record, used, bins, rings=False
                )
            yield Part(
                record,
                span,
                used,
                residual_bins,
                motion_at_bins,
                motion,
                np.array([[cosine, sine], [sine, -cosine]]) @ wave,
                nuisances[alike],
                pull,
                turns,
            )


def _amounts_of_tone(
    motion: FloatArray, used: BoolArray, turns: float
) -> tuple[float, float, float]:
    """Return the amounts of cosine, sine and one that fit a motion best where it is used."""
    (exponent,) = _exponents([turns])
    weight = used.astype(float)
    wave, double = products(weight, np.array([exponent, 2.0 * exponent]))
    count = float(weight.sum())
    gram = np.array(
        [
            [0.5 * (count + double.real), 0.5 * double.imag, wave.real],
            [0.5 * double.imag, 0.5 * (count - double.real), wave.imag],
            [wave.real, wave.imag, count],
        ]
    )
    (tone,) = products(motion, np.array([exponent]))
    right_side = np.array([tone.real, tone.imag, np.sum(motion)])
    cosine, sine, mean = np.linalg.lstsq(gram, right_side, rcond=None)[0].tolist()
    return cosine, sine, mean


def _bins_of_sine(turns: float, samples: int) -> int:
    """Return how many bins hold a sine's harmonics and their surroundings.

    Rounded up to a power of two, so that few numbers occur: of those alike the noise is read at
    once.
    """
    place = BAND_OVER_HIGHEST * (HARMONICS + 0.5) * turns * samples
    return 1 << (max(int(place), 2 * MIN_BINS) - 1).bit_length()


def _parts_in_time(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray]
) -> Iterator[Part]:
    """Yield the records of a network that runs in time, with slopes by differences."""
    if estimate.problem is None or estimate.findings.learned is not None:
        return
    step = np.eye(len(estimate.z)) * DIFFERENCE_STEP
    tones = tones_of(evidence)
    predictions = [
        [
            estimate.problem.predict(estimate.coordinates, estimate.z + sign * displacement)
            for sign in (1.0, -1.0)
        ]
        for displacement in step
    ]
    for index, (record, series) in enumerate(zip(evidence.records, predicted, strict=True)):
        if record.reference is None:
            continue
        for span in _spans(record, series):
            used = (record.mask & np.isfinite(series))[span]
            jacobian = [
                np.where(used, (ahead[index] - behind[index])[span], 0.0) / (2.0 * DIFFERENCE_STEP)
                for ahead, behind in predictions
            ]
            residual = np.where(used, record.response[span] - series[span], 0.0)
            motion = _about_mean(series[span], used)
            signals = _SignalsInTime(residual, motion, np.array(jacobian), used)
            yield _part_in_time(
                evidence, estimate, record, span, used, signals, turns=tones.get(index)
            )


def tones_of(evidence: Evidence) -> dict[int, float]:
    """Return the turns from sample to sample of each record that is a sine, by its index."""
    if evidence.tones is None:
        return {}
    entries = zip(evidence.tones.record.tolist(), evidence.tones.frequency_hz.tolist(), strict=True)
    return {index: hz / evidence.records[index].sampling_rate_hz for index, hz in entries}


def _spans(record: Record, series: FloatArray) -> list[slice]:
    """Return the pieces of what is predicted of a record; none where that is too short."""
    used = record.mask & np.isfinite(series)
    if used.sum() < MIN_SPECTRUM_SAMPLES:
        return []
    first = int(np.argmax(used))
    last = used.size - int(np.argmax(used[::-1]))
    pieces = _pieces(fast_below(last - first, MAX_LOST))
    spans = [slice(first + piece.start, first + piece.stop) for piece in pieces]
    return [span for span in spans if used[span].sum() >= MIN_SPECTRUM_SAMPLES]


def _pieces(samples: int) -> list[slice]:
    """Return the span of a record, or those of pieces of a long one.

    The pieces are evenly spread where there are many, as each costs memory.
    """
    if samples <= MAX_PIECE_SAMPLES:
        return [slice(0, samples)]
    begins = np.arange(0, samples - MIN_SPECTRUM_SAMPLES, MAX_PIECE_SAMPLES)
    chosen = begins[
        np.unique(np.linspace(0, begins.size - 1, min(begins.size, MAX_PIECES)).astype(int))
    ]
    return [slice(begin, min(begin + MAX_PIECE_SAMPLES, samples)) for begin in chosen.tolist()]


def _cut_pieces(series: FloatArray, pieces: Sequence[slice]) -> list[FloatArray]:
    """Return the pieces of a series."""
    return [series[piece].copy() for piece in pieces]


def _about_mean(series: FloatArray, used: BoolArray) -> FloatArray:
    """Return the series less its mean, zero where not used."""
    return np.where(used, series - np.mean(series[used]), 0.0)


class _SignalsInTime(NamedTuple):
    """Signals of a piece in time, zero where not used.

    Attributes:
        residual: of the fit, shape (n,).
        motion: response as the fit has it, shape (n,).
        jacobian: slopes of the response with the coordinates, shape (p, n).
        weight: of the samples in these, shape (n,).
    """

    residual: FloatArray
    motion: FloatArray
    jacobian: FloatArray
    weight: FloatArray | BoolArray

    def tapered(self) -> _SignalsInTime:
        """Return the signals times Tukey's window of mean square one.

        Motion that is cut off leaks over all bins, and with it everything that is made of it.
        """
        samples = self.motion.size
        rise = int(TAPER * samples)
        window = np.ones(samples)
        window[:rise] = hann(2 * rise)[:rise]
        window[samples - rise :] = window[:rise][::-1]
        window /= np.sqrt(np.mean(window**2))
        return _SignalsInTime(*(signal * window for signal in self))


def _part_in_time(
    evidence: Evidence,
    estimate: Estimate,
    record: Record,
    span: slice,
    used: BoolArray,
    signals: _SignalsInTime,
    turns: float | None = None,
    top_hz: float = np.inf,
) -> Part:
    """Return a piece, whose signals are in time, by its bins up to a frequency."""
    bins = int(min(top_hz / record.sampling_rate_hz, 0.5) * used.size) + 1
    residual, motion, *jacobian = _bins_of((*signals[:2], *signals.jacobian), bins)
    # Noise of the reference rings beyond either end, and so do the slopes.
    nuisance = _nuisance_bins(evidence, estimate, record, signals.weight, bins, rings=True)
    columns = np.array(jacobian)
    return Part(
        record, span, used, residual, motion, signals.motion, columns, nuisance, turns=turns
    )


def _bins_of(signals: Sequence[FloatArray], bins: int) -> ComplexArray:
    """Return the first bins of signals of one length, shape (signals, bins)."""
    return np.asarray(fft.rfft(np.stack(signals), axis=-1)[:, :bins], dtype=complex)


def _exponents(turns: Sequence[float]) -> ComplexArray:
    """Return the exponents of tones, given their turns from sample to sample."""
    return 2j * np.pi * np.asarray(turns, dtype=float)


def _nuisance_bins(
    evidence: Evidence,
    estimate: Estimate,
    record: Record,
    weight: FloatArray | BoolArray,
    bins: int,
    *,
    rings: bool,
) -> ComplexArray:
    """Return an offset, a drift, hum and free motion of the sensor, shape (q, bins).

    Args:
        evidence: the data.
        estimate: the fit.
        record: of the part.
        weight: of its samples, zero where these are not used, shape (n,).
        bins: number of bins, from 0 on.
        rings: whether t times the free motion is among them.
    """
    poles = evidence.model.linear.poles(estimate.coordinates.values(estimate.z))
    free = free_exponents(poles, record.sampling_rate_hz)
    hum = _exponents([0.0, *(hz / record.sampling_rate_hz for hz in record.hum_hz)])
    slow = motion_bins(hum, weight, bins, growing=True)
    return np.concatenate([slow, motion_bins(free, weight, bins, growing=rings)])

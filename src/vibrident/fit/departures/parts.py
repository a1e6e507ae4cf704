"""The parts of a fit that the score tests look at: residual, motion and slopes, by their bins.

They are records at the bins of their transforms, sines beside an amplitude and a phase of their
own, or the samples of a nonlinear model. Their noise is not read yet.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.departures.signals import MAX_SAMPLES_AT_ONCE, Part
from vibrident.fit.descent.settle import InNoise
from vibrident.fit.descent.weighted_bins import MAX_LOST
from vibrident.fit.estimators import Estimate
from vibrident.fit.information import inverse_normal
from vibrident.fit.problem import Evidence
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.tones import free_exponents
from vibrident.fit.response.transform import MIN_SPECTRUM_SAMPLES, waves
from vibrident.fit.uncertainty.adequacy import Points
from vibrident.fit.uncertainty.linearised import Linearised

#: Longer records are looked at in pieces of so many samples: a limit of memory.
MAX_PIECE_SAMPLES = 1 << 16
MAX_PIECES = 4
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
    """Return the parts of a fit of records, one after the other.

    Args:
        evidence: the data.
        estimate: the fit.
        predicted: response of each record, NaN where it is not defined.
        tones: of the sine records, in the order of the evidence's; None without any.
    """
    if not estimate.findings.method.is_exact or not evidence.records:
        return iter(())
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
    for place in in_noise.places(estimate.z, estimate.coordinates, all_bins=True):
        grid = place.group.grid
        if not grid.driven:
            continue
        for row, number in enumerate(place.group.segments):
            segment = segments[number]
            record = evidence.records[segment.record]
            series = predicted[segment.record][segment.span]
            used = (
                np.ones(grid.samples, dtype=bool)
                if place.group.used is None
                else place.group.used[row]
            )
            if used.sum() < MIN_SPECTRUM_SAMPLES:
                continue
            residual = place.rows.residual[row]
            jacobian = place.rows.jacobian[row]
            jacobian = jacobian * estimate.coordinates.slopes(estimate.z)[:, None]
            if grid.samples <= MAX_PIECE_SAMPLES:
                signals = (
                    residual,
                    place.rows.predicted[row],
                    np.where(used, series, 0.0),
                    jacobian,
                    place.rows.nuisances.columns[row],
                )
                tone = tones.get(segment.record)
                yield Part(record, segment.span, used, *signals, turns=tone)
                continue
            pieces = _pieces(grid.samples)
            rows = [
                _cut_pieces(np.asarray(fft.irfft(lines, grid.samples)), pieces)
                for lines in (residual, *jacobian)
            ]
            motions = _cut_pieces(_about_mean(series, used), pieces)
            for piece, motion, piece_residual, *columns in zip(pieces, motions, *rows, strict=True):
                piece_span = slice(
                    segment.span.start + piece.start, segment.span.start + piece.stop
                )
                free_motion = _free_motion(evidence, estimate, record, used[piece])
                signals_in_time = _SignalsInTime(piece_residual, motion, np.array(columns))
                yield _part_from_signals(
                    record, piece_span, used[piece], signals_in_time, free_motion
                )


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
    for place, index in enumerate(evidence.tones.record.tolist()):
        record = evidence.records[index]
        series = predicted[index]
        for span in _spans(record, series):
            used = (record.mask & np.isfinite(series))[span]
            turns = float(tones.frequency_hz[place]) / record.sampling_rate_hz
            wave = np.exp(2j * np.pi * turns * np.arange(used.size)) * used
            columns = np.stack([wave.real, wave.imag, used])
            motion_used = np.where(used, series[span], 0.0)
            amounts = np.linalg.lstsq(columns @ columns.T, columns @ motion_used, rcond=None)[0]
            # The mean of what is no whole number of periods is not where it rests.
            motion = motion_used - amounts[2] * used
            tone = (amounts[0] - 1j * amounts[1]) * wave
            residual = np.where(used, record.response[span] - series[span], 0.0)
            rows = (
                np.stack([linear.matrix[place], linear.matrix[count + place]], axis=1)
                * linear.weight[place]
            )
            signals = _SignalsInTime(residual, motion, np.stack([tone.real, -tone.imag]))
            free_motion = _free_motion(evidence, estimate, record, used)
            yield _part_from_signals(
                record, span, used, signals, free_motion, inverse @ rows, turns
            )


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
            signals = _SignalsInTime(residual, _about_mean(series[span], used), np.array(jacobian))
            free_motion = _free_motion(evidence, estimate, record, used)
            yield _part_from_signals(
                record, span, used, signals, free_motion, turns=tones.get(index)
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
    """

    residual: FloatArray
    motion: FloatArray
    jacobian: FloatArray


def _part_from_signals(
    record: Record,
    span: slice,
    used: BoolArray,
    signals: _SignalsInTime,
    free: FloatArray,
    pull: FloatArray | None = None,
    turns: float | None = None,
) -> Part:
    """Return a piece by its bins; ``free``: free motion of the sensor in it, shape (q, n)."""
    samples = used.size
    hum_turns = [hz * samples / record.sampling_rate_hz for hz in record.hum_hz]
    straight = np.linspace(-1.0, 1.0, samples)
    if pull is None:  # noise of the reference rings beyond either end, and so do the slopes
        free = np.concatenate([free, free * np.arange(samples)])
    nuisance = np.concatenate(
        [used[None] * 1.0, used[None] * straight, waves(hum_turns, samples) * used, free]
    )
    residual, bins, columns, nuisance_bins = (
        np.asarray(fft.rfft(signal, axis=-1), dtype=complex) for signal in (*signals, nuisance)
    )
    return Part(
        record, span, used, residual, bins, signals.motion, columns, nuisance_bins, pull, turns
    )


def _free_motion(
    evidence: Evidence, estimate: Estimate, record: Record, used: BoolArray
) -> FloatArray:
    """Return free motion of the sensor, zero where not used, shape (q, n)."""
    poles = evidence.model.linear.poles(estimate.coordinates.values(estimate.z))
    exponents = free_exponents(poles, record.sampling_rate_hz)
    free_waves: ComplexArray = np.exp(exponents[:, None] * np.arange(used.size)) * used
    return np.concatenate([free_waves.real, free_waves.imag[exponents.imag > 0.0]])

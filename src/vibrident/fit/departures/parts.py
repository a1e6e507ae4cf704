"""The parts of a fit that the score tests look at: residual, motion and slopes, by their bins.

Records at the bins of their transforms, sines beside an amplitude and a phase of their own, or the
samples of a nonlinear model. Their noise is not read yet.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.departures.signals import AT_ONCE
from vibrident.fit.descent.settle import InNoise
from vibrident.fit.descent.weighed import MAX_LOST
from vibrident.fit.estimators import Estimate
from vibrident.fit.information import inverse_normal
from vibrident.fit.problem import Evidence
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.tones import free_exponents
from vibrident.fit.response.transform import (
    MIN_SPECTRUM_SAMPLES,
    waves,
)
from vibrident.fit.uncertainty.adequacy import Points
from vibrident.fit.uncertainty.linearised import Linearised

#: Longer records are looked at in pieces of so many samples, so many of them: a limit of memory.
LONGEST, MOST_PIECES = 1 << 16, 4
#: Central differences of a nonlinear model's response, in its coordinates.
STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Part:
    """A record, or a piece of it, of which the noise is not read yet.

    Attributes:
        record: the record.
        span: its samples, n in number.
        used: those that count, shape (n,).
        rest: residual, shape (K,).
        bins: response to the reference, shape (K,).
        motion: response as the fit has it, in time, shape (n,).
        columns: of the response's slopes with the coordinates, shape (p, K).
        nuisance: columns of the nuisance parameters, shape (m, K).
        pull: shift of the fit's coordinates by those of the record, shape (P, p); None: the same.
        turns: of the record's sine from sample to sample; None for other motion.
    """

    record: Record
    span: slice
    used: BoolArray
    rest: ComplexArray
    bins: ComplexArray
    motion: FloatArray
    columns: ComplexArray
    nuisance: ComplexArray
    pull: FloatArray | None = None
    turns: float | None = None

    @property
    def beside(self) -> ComplexArray:
        """Return the columns that are no noise, shape (q, K)."""
        if self.pull is None:
            return self.nuisance
        return np.concatenate([self.nuisance, self.columns])  # a misfit of the tone is no noise

    @property
    def floor(self) -> float:
        """Return the lower limit of the noise."""
        largest = float(np.max(np.abs(self.record.response[self.span])))
        return (np.finfo(float).eps * largest) ** 2

    @property
    def alike(self) -> tuple[float, ...]:
        """Return what parts have in common whose noise is read together."""
        counts = self.used.size, self.rest.size, len(self.beside), self.record.reference_noise_order
        return self.record.sampling_rate_hz, *counts, self.pull is None, self.turns is None


def at_once(parts: Iterable[Part]) -> Iterator[list[Part]]:
    """Yield as many parts as are worked on at once."""
    held = list[Part]()
    for part in parts:
        held.append(part)
        if sum(each.used.size for each in held) >= AT_ONCE:
            yield held
            held = []
    if held:
        yield held


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
        return _of_bins(evidence, estimate, estimate.in_noise, predicted)
    if evidence.only_sines and evidence.model.is_linear and tones is not None:
        return _of_sines(evidence, estimate, predicted, tones)
    return _of_samples(evidence, estimate, predicted)


def _of_bins(
    evidence: Evidence, estimate: Estimate, in_noise: InNoise, predicted: Sequence[FloatArray]
) -> Iterator[Part]:
    """Of the segments that the fit is of, at all bins that count."""
    tones, segments = tones_of(evidence), in_noise.band.problem.segments
    for place in in_noise.places(estimate.z, estimate.coordinates, all_bins=True):
        grid = place.group.grid
        if not grid.driven:
            continue
        for row, number in enumerate(place.group.segments):
            segment = segments[number]
            given, series = (
                evidence.records[segment.record],
                predicted[segment.record][segment.span],
            )
            used = (
                np.ones(grid.samples, dtype=bool)
                if place.group.used is None
                else place.group.used[row]
            )
            if used.sum() < MIN_SPECTRUM_SAMPLES:
                continue
            rest, jacobian = place.rows.residual[row], place.rows.jacobian[row]
            jacobian = jacobian * estimate.coordinates.slopes(estimate.z)[:, None]
            if grid.samples <= LONGEST:
                signals = (
                    rest,
                    place.rows.predicted[row],
                    np.where(used, series, 0.0),
                    jacobian,
                    place.rows.nuisances.columns[row],
                )
                tone = tones.get(segment.record)
                yield Part(given, segment.span, used, *signals, turns=tone)
                continue
            pieces = _pieces(grid.samples)
            rows = [
                _cut(np.asarray(fft.irfft(each, grid.samples)), pieces)
                for each in (rest, *jacobian)
            ]
            motions = _cut(_about_mean(series, used), pieces)
            for piece, motion, left, *columns in zip(pieces, motions, *rows, strict=True):
                there = slice(segment.span.start + piece.start, segment.span.start + piece.stop)
                free = _free_motion(evidence, estimate, given, used[piece])
                own = _InTime(left, motion, np.array(columns))
                yield _in_time(given, there, used[piece], own, free)


def _of_sines(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray], tones: Points
) -> Iterator[Part]:
    """Each beside an amplitude and a phase of its own, which the points give to the fit."""
    assert evidence.tones is not None
    count = len(tones.frequency_hz)
    linear = Linearised.of_points(
        estimate.coordinates,
        estimate.z,
        evidence.quantity,
        tones.frequency_hz,
        tones.measured,
        tones.relative_deviation,
    )
    inverse = inverse_normal(linear.matrix.T @ linear.matrix)
    for place, index in enumerate(evidence.tones.record.tolist()):
        record, series = evidence.records[index], predicted[index]
        for span in _spans(record, series):
            used = (record.mask & np.isfinite(series))[span]
            turns = float(tones.frequency_hz[place]) / record.sampling_rate_hz
            wave = np.exp(2j * np.pi * turns * np.arange(used.size)) * used
            columns = np.stack([wave.real, wave.imag, used])
            moved = np.where(used, series[span], 0.0)
            share = np.linalg.lstsq(columns @ columns.T, columns @ moved, rcond=None)[0]
            motion = (
                moved - share[2] * used
            )  # the mean of what is no whole number of periods is not where it rests
            tone = (share[0] - 1j * share[1]) * wave
            rest = np.where(used, record.response[span] - series[span], 0.0)
            rows = (
                np.stack([linear.matrix[place], linear.matrix[count + place]], axis=1)
                * linear.weight[place]
            )
            own = _InTime(rest, motion, np.stack([tone.real, -tone.imag]))
            free = _free_motion(evidence, estimate, record, used)
            yield _in_time(record, span, used, own, free, inverse @ rows, turns)


def _of_samples(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray]
) -> Iterator[Part]:
    """Of a network that runs in time, with slopes by differences."""
    if estimate.problem is None or estimate.findings.learned is not None:
        return
    step, tones = np.eye(len(estimate.z)) * STEP, tones_of(evidence)
    ends = [
        [
            estimate.problem.predict(estimate.coordinates, estimate.z + sign * each)
            for sign in (1.0, -1.0)
        ]
        for each in step
    ]
    for index, (record, series) in enumerate(zip(evidence.records, predicted, strict=True)):
        if record.reference is None:
            continue
        for span in _spans(record, series):
            used = (record.mask & np.isfinite(series))[span]
            jacobian = [
                np.where(used, (up[index] - down[index])[span], 0.0) / (2.0 * STEP)
                for up, down in ends
            ]
            rest = np.where(used, record.response[span] - series[span], 0.0)
            own = _InTime(rest, _about_mean(series[span], used), np.array(jacobian))
            free = _free_motion(evidence, estimate, record, used)
            yield _in_time(record, span, used, own, free, turns=tones.get(index))


def tones_of(evidence: Evidence) -> dict[int, float]:
    """Turns from sample to sample of each record that is a sine."""
    if evidence.tones is None:
        return {}
    every = zip(evidence.tones.record.tolist(), evidence.tones.frequency_hz.tolist(), strict=True)
    return {index: hz / evidence.records[index].sampling_rate_hz for index, hz in every}


def _spans(record: Record, series: FloatArray) -> list[slice]:
    """Pieces of what is predicted of a record; none where that is too short."""
    used = record.mask & np.isfinite(series)
    if used.sum() < MIN_SPECTRUM_SAMPLES:
        return []
    first, last = int(np.argmax(used)), used.size - int(np.argmax(used[::-1]))
    pieces = _pieces(fast_below(last - first, MAX_LOST))
    spans = [slice(first + piece.start, first + piece.stop) for piece in pieces]
    return [span for span in spans if used[span].sum() >= MIN_SPECTRUM_SAMPLES]


def _pieces(samples: int) -> list[slice]:
    """A record, or pieces of a long one: evenly spread where it has many, as each costs memory."""
    if samples <= LONGEST:
        return [slice(0, samples)]
    every = np.arange(0, samples - MIN_SPECTRUM_SAMPLES, LONGEST)
    kept = every[
        np.unique(np.linspace(0, every.size - 1, min(every.size, MOST_PIECES)).astype(int))
    ]
    return [slice(begin, min(begin + LONGEST, samples)) for begin in kept.tolist()]


def _cut(series: FloatArray, pieces: Sequence[slice]) -> list[FloatArray]:
    return [series[piece].copy() for piece in pieces]


def _about_mean(series: FloatArray, used: BoolArray) -> FloatArray:
    return np.where(used, series - np.mean(series[used]), 0.0)


class _InTime(NamedTuple):
    """Signals of a piece in time, zero where not used.

    Attributes:
        rest: residual, shape (n,).
        motion: response as the fit has it, shape (n,).
        jacobian: slopes of the response with the coordinates, shape (p, n).
    """

    rest: FloatArray
    motion: FloatArray
    jacobian: FloatArray


def _in_time(
    record: Record,
    span: slice,
    used: BoolArray,
    signals: _InTime,
    free: FloatArray,
    pull: FloatArray | None = None,
    turns: float | None = None,
) -> Part:
    """Return a piece by its bins; ``free``: free motion of the sensor in it, shape (q, n)."""
    n = used.size
    known = [hz * n / record.sampling_rate_hz for hz in record.hum_hz]
    straight = np.linspace(-1.0, 1.0, n)
    if pull is None:  # noise of the reference rings beyond either end, and so do the slopes
        free = np.concatenate([free, free * np.arange(n)])
    nuisance = np.concatenate(
        [used[None] * 1.0, used[None] * straight, waves(known, n) * used, free]
    )
    rest, bins, columns, beside = (
        np.asarray(fft.rfft(signal, axis=-1), dtype=complex) for signal in (*signals, nuisance)
    )
    return Part(record, span, used, rest, bins, signals.motion, columns, beside, pull, turns)


def _free_motion(
    evidence: Evidence, estimate: Estimate, record: Record, used: BoolArray
) -> FloatArray:
    """Return free motion of the sensor, zero where not used, shape (q, n)."""
    poles = evidence.model.linear.poles(estimate.coordinates.values(estimate.z))
    lasting = free_exponents(poles, record.sampling_rate_hz)
    waves_of: ComplexArray = np.exp(lasting[:, None] * np.arange(used.size)) * used
    return np.concatenate([waves_of.real, waves_of.imag[lasting.imag > 0.0]])

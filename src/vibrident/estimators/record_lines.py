"""A record's residual, and all that could change it, at the lines of its discrete Fourier transform."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy import fft

from vibrident.discretize import Weights
from vibrident.measure.lines import line_counts, line_frequencies
from vibrident.measure.response import ComplexArray
from vibrident.network.sensitivity import Normal
from vibrident.problem import Coordinates, TimeProblem
from vibrident.records import BoolArray, FloatArray, Record

T = TypeVar("T")
#: Free responses of a record in pieces are not looked at beyond so many columns, or so many numbers: its samples keep
#: equal weights.
MOST_COLUMNS, LARGEST = 400, 1e8
#: Of longer records nothing is kept that can be made again.
LONG = 2**18
#: Step of the central differences of the response.
STEP = 1e-5


@dataclass(frozen=True, eq=False)
class RecordLines:
    """One record from the first to the last sample that counts, in units of the noise that it was weighted by.

    Whole samples only: zeros at the edges would be motion that no initial state explains, and leak over all lines.

    Attributes:
        residual: measured less network, zero where not used, shape (lines,).
        predicted: the network's response, shape (lines,).
        used: shape (n,).
        twice: how often a line counts in a sum over all, shape (lines,).
        slopes: of the response with z, shape (p, lines).
        segments: place, output and transition of each segment; none where they are too many to be looked at.
        response: the model's, H, at the lines for given z; None without a reference.
        z: where the network was evaluated, shape (p,).
        floor: variance that no residual is believed to be below.
    """

    residual: ComplexArray
    predicted: ComplexArray
    used: BoolArray
    twice: FloatArray
    slopes: ComplexArray
    segments: tuple[tuple[slice, FloatArray, FloatArray], ...]
    response: Callable[[FloatArray], ComplexArray] | None
    z: FloatArray
    floor: float

    @property
    def samples(self) -> int:
        """Number of samples from first to last."""
        return int(self.used.shape[0])

    @property
    def count(self) -> float:
        """Number of samples that are used."""
        return float(self.used.sum())

    @property
    def through(self) -> ComplexArray | None:
        """H at z, shape (lines,)."""
        return None if self.response is None else self.response(self.z)

    def slope_of(self, of_response: Callable[[ComplexArray], T]) -> list[T]:
        """Slopes with each coordinate of what is linear in H, by central differences."""
        assert self.response is not None
        ends = np.eye(len(self.z)) * STEP
        return [of_response((self.response(self.z + e) - self.response(self.z - e)) / (2.0 * STEP)) for e in ends]

    def unknowns(self, *, edges: bool, tones: tuple[float, ...]) -> ComplexArray:
        """Lines of what is unknown beside the parameters, shape (lines, m).

        Args:
            edges: beside initial states, offset and drift of each segment, the slopes of these.
            tones: places, in lines, of tones; each with its slope with frequency.
        """
        free = sum(len(output) + 2 for _, output, _ in self.segments)
        columns = np.empty((len(self.twice), (2 if edges else 1) * free + 4 * len(tones)), dtype=complex, order="F")
        for column, lines in zip(columns.T, self._unknown(edges, tones), strict=True):
            column[:] = lines
        return columns

    def _unknown(self, edges: bool, tones: tuple[float, ...]) -> Iterator[ComplexArray]:
        """One after another: of a long record each is large."""
        yield from self._kept_free if self.samples <= LONG else map(_lines, self._free_in_time())
        turn = np.arange(self.samples) / max(self.samples, 1)
        if edges:
            for column in self._free_in_time():
                yield _lines(turn * column)
        for place in tones:
            for wave in (np.cos, np.sin):
                tone = wave(2.0 * np.pi * place * turn) * self.used
                yield _lines(tone)
                yield _lines((turn - 0.5) * tone)

    @functools.cached_property
    def _kept_free(self) -> tuple[ComplexArray, ...]:
        return tuple(map(_lines, self._free_in_time()))

    def _free_in_time(self) -> Iterator[FloatArray]:
        """What initial states, offset and drift of each segment add."""
        for run, output, transition in self.segments:
            count = run.stop - run.start
            for rows in (*_powers(output, transition, count).T, np.ones(count), np.linspace(-1.0, 1.0, count)):
                placed = np.zeros(self.samples)
                placed[run] = rows * self.used[run] / max(float(np.sqrt(np.sum(rows**2))), 1e-300)
                yield placed

    def where_used(self, lines: ComplexArray) -> ComplexArray:
        """Lines of the signal of these lines, set to zero where the record is not used."""
        if self.used.all():
            return lines
        return np.asarray(fft.rfft(np.asarray(fft.irfft(lines, self.samples)) * self.used))


def record_lines(
    problem: TimeProblem, normal: Normal, coordinates: Coordinates, z: FloatArray, noise: FloatArray
) -> list[RecordLines]:
    """Every record that has samples to use.

    Args:
        problem: the records.
        normal: the network at ``z``.
        coordinates: the map from z to parameters.
        z: shape (p,).
        noise: standard deviation by which each record was weighted, shape (records,).
    """
    responses = problem.by_record(normal.response)
    weights = problem.weights(coordinates.physical(z))
    known = [record.mask & np.isfinite(own) for record, own in zip(problem.records, responses, strict=True)]
    spans = [_span(whole) for whole in known]
    masks = [whole[span] for whole, span in zip(known, spans, strict=True)]
    del known
    slopes = [np.empty((len(z), len(used) // 2 + 1), dtype=complex) for used in masks]
    for number, column in enumerate(normal.columns):  # of long records each is made when it is asked for
        for own, series, span, used in zip(slopes, problem.by_record(column), spans, masks, strict=True):
            own[number] = _lines(np.where(used, series[span], 0.0))
    found = []
    for index, (record, span, used) in enumerate(zip(problem.records, spans, masks, strict=True)):
        misses = (record.response - responses[index])[span] / noise[index]
        found.append(
            RecordLines(
                residual=_lines(np.where(used, misses, 0.0)),
                predicted=_lines(np.where(used, responses[index][span], 0.0) / noise[index]),
                used=used,
                twice=line_counts(len(used)),
                slopes=slopes[index],
                segments=_segments(problem, weights, index, span),
                response=_response(problem, coordinates, record, len(used)),
                z=z,
                floor=float((problem.noise_floor[index] / noise[index]) ** 2),
            )
        )
    return found


def _span(known: BoolArray) -> slice:
    """From the first known sample on, nearly to the last.

    A length with a large prime factor takes many times as long: some samples less hardly matter.
    """
    places = np.flatnonzero(known)
    if not places.size:
        return slice(0, 0)
    return slice(int(places[0]), int(places[0]) + int(fft.prev_fast_len(int(places[-1] - places[0]) + 1) or 0))


def _segments(
    problem: TimeProblem, weights: Weights, index: int, span: slice
) -> tuple[tuple[slice, FloatArray, FloatArray], ...]:
    """Segments of a record within its span; none where their free responses would be too many."""
    outputs, transitions = np.asarray(weights.output), np.asarray(weights.transition)
    rates = np.asarray(problem.lanes.rate)
    found = []
    for owner, run, lane in problem.pieces:
        start, stop = max(run.start, span.start) - span.start, min(run.stop, span.stop) - span.start
        if owner == index and stop - start > 1:
            found.append((slice(start, stop), outputs[int(rates[lane])], transitions[int(rates[lane])]))
    columns = len(found) * (outputs.shape[-1] + 2)
    too_many = columns > MOST_COLUMNS or columns * (span.stop - span.start) > LARGEST
    return () if too_many else tuple(found)


def _lines(signal: FloatArray) -> ComplexArray:
    if not signal.size:
        return np.zeros((signal.shape[0] // 2 + 1, *signal.shape[1:]), dtype=complex)
    return np.asarray(fft.rfft(signal, axis=0))


def _powers(output: FloatArray, transition: FloatArray, count: int) -> FloatArray:
    """C Φ^k for k < count, shape (count, n), by doubling."""
    rows, power = output[None, :], transition
    while rows.shape[0] < count:
        rows = np.concatenate([rows, rows @ power])
        power = power @ power
    return rows[:count]


def _response(
    problem: TimeProblem, coordinates: Coordinates, record: Record, samples: int
) -> Callable[[FloatArray], ComplexArray] | None:
    """H as a function of z at the lines of a record's transform."""
    if record.reference is None or samples < 2:
        return None
    frequency = line_frequencies(samples, record.sampling_rate_hz)

    def at(z: FloatArray) -> ComplexArray:
        values = coordinates.values(z)
        found = coordinates.model.frequency_response(values, frequency, problem.layout.quantity)
        return np.asarray(found, dtype=complex)

    return at

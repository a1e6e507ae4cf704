"""Records as unbroken segments of steps, and their transforms.

The inputs of a step are weighted sums of the samples around it. Their transforms need no signals of
their own: with A(z) the transform of the run's reference, Σ_s h_j[s] z^s that of the filter of
input j, and the samples beyond either end of the run put in,

    U_j(z) = A(z) Σ_s h_j[s] z^s + (a polynomial in z of as many coefficients as the filter has).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.base.fft_lengths import fast_below
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import runs_of_true
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import MAX_CACHED_SAMPLES
from vibrident.physics.discretisation.inputs import StepFilters, StepInputs, filtered
from vibrident.physics.models import SensorModel

_Step = TypeVar("_Step", StepInputs, StepFilters)

#: Runs of at most so many samples keep all of them.
MAX_UNCUT_SAMPLES = 1 << 13
#: A longer gap divides a run.
MAX_GAP_SAMPLES = 64
#: Samples of the shortest piece between two gaps whose noise is read on its own.
MIN_PIECE_SAMPLES = 1024
#: Columns of a tone: cosine, sine, and both growing with time.
TONE_COLUMNS = 4
#: A tone is kept this fraction of a line off the lines, where its transform has poles; its slopes
#: compensate for that.
MIN_LINE_DISTANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Drive:
    """Reference of a record as the network takes it.

    Attributes:
        signals: the reference filtered by the factors of the model that are not rational, and its
            derivatives with each of their parameters, each of shape (samples,).
        valid: where all samples that these need are valid, shape (samples,).
    """

    signals: tuple[FloatArray, ...]
    valid: BoolArray


def driven_by(
    record: Record,
    model: SensorModel,
    factor_values: Mapping[str, float],
    offset: float | None = None,
) -> Drive:
    """Return the reference that drives the network of a record.

    Args:
        record: the record.
        model: the sensor model.
        factor_values: parameters of its factors that are not rational, by name.
        offset: of the reference, in its unit; None: its mean.
    """
    reference, valid = network_reference(record, offset)
    if not factor_values or record.reference is None:
        return Drive((reference,) * (1 + len(factor_values)), valid)
    rate_hz = record.sampling_rate_hz

    def factors(turns: FloatArray) -> ComplexArray:
        return np.asarray(model.factors(factor_values, turns * rate_hz))

    def factor_slope(name: str, turns: FloatArray) -> ComplexArray:
        return np.asarray(model.factor_slopes(factor_values, turns * rate_hz)[name])

    responses = [factors, *(functools.partial(factor_slope, name) for name in factor_values)]
    signals, places = zip(
        *(filtered(reference, valid, response) for response in responses), strict=True
    )
    return Drive(signals, np.logical_and.reduce(places))


@dataclass(frozen=True, eq=False)
class Transforms:
    """Transforms of a run, computed when they are needed.

    Attributes:
        record: the record.
        span: the run, in samples of the response.
        step: computes the inputs of its steps.
        drive: the reference as the network takes it.
    """

    record: Record
    span: slice
    step: StepFilters
    drive: Drive

    @functools.cached_property
    def inputs(self) -> ComplexArray:
        """Return the inputs of the steps, q rows of each signal in turn, shape (…, L).

        Zero for a decay.
        """
        if self.record.reference is None:
            lines = (self.span.stop - self.span.start) // 2 + 1
            return np.zeros(
                (len(self.drive.signals) * self.step.filters.shape[0], lines), dtype=complex
            )
        by_signal = [input_lines(signal, self.span, self.step) for signal in self.drive.signals]
        return np.concatenate(by_signal) if len(by_signal) > 1 else by_signal[0]

    @functools.cached_property
    def response(self) -> ComplexArray:
        """Return the transform of the response, zero where it is not used, shape (L,)."""
        return np.asarray(
            fft.rfft(np.where(self.record.mask[self.span], self.record.response[self.span], 0.0))
        )

    def forget_inputs(self) -> None:
        """Free the inputs of a long run, which are recomputed if needed."""
        if self.span.stop - self.span.start > MAX_CACHED_SAMPLES:
            self.__dict__.pop("inputs", None)


@dataclass(frozen=True, eq=False)
class Segment:
    """Unbroken run of N steps of one record, at the L = N // 2 + 1 lines of its transform.

    Attributes:
        record: index of the record.
        span: samples of the response.
        transforms: of inputs and response.
        used: which samples of the response are used, shape (N,); None: all of them.
        hum: places of tones that no motion causes, in lines.
    """

    record: int
    span: slice
    transforms: Transforms
    used: BoolArray | None = None
    hum: tuple[float, ...] = ()

    @property
    def samples(self) -> int:
        """Return the number of steps N."""
        return int(self.span.stop - self.span.start)

    @property
    def inputs(self) -> ComplexArray:
        """Return the transforms of the inputs of the steps, shape (q, L)."""
        return self.transforms.inputs

    @property
    def response(self) -> ComplexArray:
        """Return the transform of the response, shape (L,)."""
        return self.transforms.response

    def driven(self, drive: Drive) -> Segment:
        """Return the segment with another reference."""
        return replace(self, transforms=replace(self.transforms, drive=drive))

    def idle(self) -> Segment:
        """Return the segment without its transforms, which are recomputed if needed."""
        return replace(self, transforms=replace(self.transforms))


def shifted_lines(samples: int, lines: slice = slice(None)) -> ComplexArray:
    """Return W = z − 1 at the lines of a run of N samples, or at some, shape (lines,).

    Do not write to it.
    """
    if samples <= MAX_CACHED_SAMPLES:
        return _cached_shifted_lines(samples)[lines]
    angle = 2.0 * np.pi / samples * np.arange(*lines.indices(samples // 2 + 1))
    return -2.0 * np.sin(0.5 * angle) ** 2 + 1j * np.sin(angle)


def tone_bins(places: Sequence[float], samples: int, lines: slice = slice(None)) -> ComplexArray:
    """Return bins of tones, each with a slow change of amplitude and phase, shape (4 tones, lines).

    The tones are the free motion of undamped oscillators: z w^k / q and z w^k / q², k = 0, 1, with
    q = w² + c w + c and c = 4 sin²(πp/N) span the bins of cos, sin, t cos and t sin at place p.
    """
    w = shifted_lines(samples, lines)
    near = np.round(places)
    offsets = np.asarray(places, dtype=float) - near
    offsets = np.where(
        np.abs(offsets) < MIN_LINE_DISTANCE, np.copysign(MIN_LINE_DISTANCE, offsets), offsets
    )
    z = 1.0 + w
    columns = np.empty((len(offsets), TONE_COLUMNS, len(w)), dtype=complex)
    coefficients = 4.0 * np.sin(np.pi / samples * (near + offsets)) ** 2
    for rows, c in zip(columns, coefficients.tolist(), strict=True):
        ratio = c / ((w + c) * w + c)
        np.multiply(z, ratio, out=rows[0])
        np.multiply(rows[0], ratio, out=rows[2])
        np.multiply(rows[0:4:2], w, out=rows[1:4:2])
    return columns.reshape(-1, len(w))


@functools.lru_cache(maxsize=8)
def _cached_shifted_lines(samples: int) -> ComplexArray:
    """Return W = z − 1 at all lines, read-only."""
    shifted: ComplexArray = np.expm1(2j * np.pi / samples * np.arange(samples // 2 + 1))
    shifted.flags.writeable = False
    return shifted


def segment_of(
    number: int, record: Record, span: slice, step: StepFilters, drive: Drive
) -> Segment:
    """Return a run with its transforms at all lines from 0 to half the sampling rate.

    Args:
        number: of the record.
        record: the record; the reference is valid all over the run.
        span: the run, in samples of the response.
        step: computes the inputs of its steps.
        drive: the reference as the network takes it.
    """
    used = record.mask[span]
    hum = hum_of(record, len(used))
    return Segment(
        number, span, Transforms(record, span, step, drive), None if used.all() else used, hum
    )


def hum_of(record: Record, samples: int) -> tuple[float, ...]:
    """Return the places of the record's tones of hum, in lines of so many samples."""
    return tuple(hz * samples / record.sampling_rate_hz for hz in record.hum_hz)


def network_reference(record: Record, offset: float | None) -> tuple[FloatArray, BoolArray]:
    """Return the reference without its offset, or mean, and where it is valid.

    It is zero for a free decay and where it is not valid.
    """
    if record.reference is None:
        return np.zeros(record.samples), np.ones(record.samples, dtype=bool)
    used = record.reference_mask
    if not used.any():
        return np.zeros(record.samples), used
    middle = float(record.reference[used].mean()) if offset is None else offset
    return np.where(used, record.reference - middle, 0.0), used


def usable_steps(step: _Step, record: Record) -> _Step:
    """Return the steps of a record without those that lack an input.

    Without a reference nothing is interpolated: a free decay keeps its first samples, which carry
    most information. A step goes from one sample to the next.
    """
    if record.reference is not None:
        return step
    return replace(step, usable=np.arange(record.samples) < record.samples - 1)


def unbroken(usable: BoolArray) -> list[slice]:
    """Return the runs of True."""
    begins, ends = runs_of_true(usable)
    return [slice(*run) for run in zip(begins.tolist(), ends.tolist(), strict=True)]


def between_gaps(run: slice, used: BoolArray) -> list[slice]:
    """Return a run of usable steps without long gaps in the response and without unused ends.

    What is behind a long gap has initial states of its own: far fewer numbers than the samples of
    the gap are. Where a piece would be short, the run stays whole: it would not tell its noise.

    Args:
        run: the run.
        used: samples of the response that are used, shape (samples,).
    """
    begins, ends = (edges + run.start for edges in runs_of_true(~used[run]))
    in_piece = np.zeros(used.size, dtype=bool)
    in_piece[run] = True
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        is_inside = begin > run.start and end < run.stop
        in_piece[begin:end] = is_inside and end - begin <= MAX_GAP_SAMPLES
    pieces = unbroken(in_piece)
    if any(piece.stop - piece.start < MIN_PIECE_SAMPLES for piece in pieces):
        return [slice(pieces[0].start, pieces[-1].stop)]
    return pieces


def transformable(span: slice) -> slice:
    """Return the run, without its last samples where that transforms many times faster.

    Short runs keep all samples.
    """
    samples = span.stop - span.start
    return (
        span
        if samples <= MAX_UNCUT_SAMPLES
        else slice(span.start, span.start + fast_below(samples))
    )


def input_lines(reference: FloatArray, span: slice, step: StepFilters) -> ComplexArray:
    """Return the transforms of the inputs of the steps of a run at all lines, shape (q, L).

    Args:
        reference: of the whole record, shape (samples,).
        span: the run; every sample that its steps need exists.
        step: the filters, and their place.
    """
    samples = span.stop - span.start
    taps = step.filters.shape[1]
    delay = step.first + taps // 2  # brings the middle of the filters to the samples of the run
    begin = span.start + delay
    before = taps // 2  # taps are at −before … taps − before − 1 relative to ``begin``
    lines = np.asarray(fft.rfft(reference[begin : begin + samples]))
    # Samples after the run less those at its begin, from ``before`` samples ahead of either.
    reach = max(taps - 1, 1)
    at_end = _padded(reference, begin + samples - before, reach)
    at_begin = _padded(reference, begin - before, reach)
    jump = at_end - at_begin
    edges = _edges(step.filters, before, jump)
    if samples <= MAX_CACHED_SAMPLES:
        filters = step.filters
        inputs = _polynomial(edges, -before, samples)
        inputs += lines * _cached_polynomial(filters.shape, filters.tobytes(), -before, samples)
        return inputs
    inputs = np.empty((len(edges), len(lines)), dtype=complex)
    # Of a long run each copy counts.
    for row, edge, taps_of_row in zip(inputs, edges, step.filters, strict=True):
        row[:] = _polynomial(taps_of_row, -before, samples)
        row *= lines
        row += _polynomial(edge, -before, samples)
    return inputs


def _padded(values: FloatArray, begin: int, count: int) -> FloatArray:
    """Return ``count`` values from ``begin`` on, zero beyond either end of the record.

    No tap that counts reaches there.
    """
    padded = np.zeros(count)
    first = max(begin, 0)
    last = min(begin + count, len(values))
    if first < last:
        padded[first - begin : last - begin] = values[first:last]
    return padded


def _edges(filters: FloatArray, before: int, jump: FloatArray) -> FloatArray:
    """Return coefficients g[j, p] of z^p, p = −before …, that the ends of the run add.

    Their shape is (q, taps). With e[i] = a[N + i] − a[i]: g[p] = Σ_{s ≥ p} h[s] e[s − p] for p ≥ 1,
    and −Σ_{s < p} h[s] e[s − p] for p ≤ 0.
    """
    places, signs = _edge_places(filters.shape[1], before)
    return filters @ (signs * jump[places])


@functools.lru_cache(maxsize=8)
def _edge_places(taps: int, before: int) -> tuple[NDArray[np.int_], FloatArray]:
    """Return the place of e[s − p] and its sign for tap s and power p, both (taps, taps)."""
    s, p = np.meshgrid(np.arange(taps) - before, np.arange(taps) - before, indexing="ij")
    signs = np.where((p >= 1) & (s >= p), 1.0, 0.0) - np.where((p <= 0) & (s < p), 1.0, 0.0)
    return np.where(signs != 0.0, before + s - p, 0), signs


def _polynomial(coefficients: FloatArray, first: int, samples: int) -> ComplexArray:
    """Return Σ_i c[…, i] z^{first + i} at the lines of N samples, shape (…, L)."""
    placed = np.zeros((*coefficients.shape[:-1], samples))
    places = np.arange(first, first + coefficients.shape[-1]) % samples
    np.add.at(placed.T, places, coefficients.T)  # z^N = 1: of a short run several coefficients meet
    lines = np.asarray(fft.rfft(placed))
    return np.conj(lines, out=lines)  # z^p, where a transform has z^{−p}


@functools.lru_cache(maxsize=8)
def _cached_polynomial(
    shape: tuple[int, ...], coefficients: bytes, first: int, samples: int
) -> ComplexArray:
    """Return :func:`_polynomial` of coefficients given as bytes, cached."""
    return _polynomial(np.frombuffer(coefficients).reshape(shape), first, samples)

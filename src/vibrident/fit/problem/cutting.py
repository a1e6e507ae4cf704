"""Records cut into lanes of equal length, the input of the unrolled network."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.fit.bins.segments import seen_by_network, unbroken
from vibrident.physics.discretisation import Method
from vibrident.physics.discretisation.inputs import StepInputs
from vibrident.physics.network.unroll import Lanes

#: Bytes of which the address of an array is a multiple, where JAX need not copy it.
ALIGNED = 64


@dataclass(frozen=True, eq=False)
class Piece:
    """An unbroken run of steps of one record.

    Attributes:
        record: number of the record.
        run: its samples.
        step: the inputs of the record's steps.
    """

    record: int
    run: slice
    step: StepInputs

    @property
    def steps(self) -> int:
        """Number of steps."""
        return int(self.run.stop - self.run.start)


def steps_of(
    records: Sequence[Record], method: Method, terms: int, delay_s: float, *, linear: bool
) -> Sequence[StepInputs]:
    """Inputs of every record's steps.

    Args:
        records: the records.
        method: the discretisation.
        terms: inputs a step.
        delay_s: at which the inputs are taken.
        linear: a nonlinear spring depends on its rest position: its reference loses the offset, not the mean
            of a motion that ends within a period.
    """
    late = [delay_s * record.sampling_rate_hz for record in records]
    return [method.inputs(*seen_by_network(r, centred=linear), terms, d) for r, d in zip(records, late, strict=True)]


def pieces_of(records: Sequence[Record], steps: Sequence[StepInputs], fewest: int) -> list[Piece]:
    """The runs of usable steps that hold more than ``fewest`` samples."""
    return [
        Piece(index, run, step)
        for index, (record, step) in enumerate(zip(records, steps, strict=True))
        for run in unbroken(step.usable)
        if np.sum(record.mask[run]) > fewest
    ]


def bucket(count: int) -> int:
    """The next number of the form m·2ᵏ with 8 ≤ m ≤ 16: at most an eighth more."""
    step = max(1, 1 << (max(count - 1, 1).bit_length() - 4)) if count > 16 else 1
    return -(-count // step) * step


def cut(
    pieces: Sequence[Piece], records: Sequence[Record], rate: np.ndarray, terms: int, length: int
) -> tuple[Lanes, list[int]]:
    """Cut segments into chunks of ``length`` steps, the last one padded with weight zero; also each one's first lane.

    Args:
        pieces: the segments.
        records: the records.
        rate: which sampling interval each record has.
        terms: inputs a step.
        length: steps a chunk.
    """
    counts = [-(-piece.steps // length) for piece in pieces]
    total = bucket(sum(counts))  # padded, so that calibrations of about the same size share one compiled program
    response, weight = _zeros(length, total), _zeros(length, total)
    first, segment, rates = np.ones(total, dtype=bool), np.full(total, len(pieces)), np.zeros(total, dtype=int)
    places, lane = [], 0
    for number, (piece, count) in enumerate(zip(pieces, counts, strict=True)):
        mine, record = slice(lane, lane + count), records[piece.record]
        mask = record.mask[piece.run]
        weight[:, mine] = _part(mask, 0, count * length).reshape(count, length).T
        response[:, mine] = _part(record.response[piece.run] * mask, 0, count * length).reshape(count, length).T
        first[mine], segment[mine], rates[mine] = False, number, rate[piece.record]
        first[lane] = True
        places.append(mine)
        lane += count
    inputs = _inputs(pieces, places, total, length, terms)
    return Lanes(inputs, response, weight, first, segment, rates), [place.start for place in places]


def _inputs(pieces: Sequence[Piece], places: Sequence[slice], total: int, length: int, terms: int) -> FloatArray:
    """Inputs of every step, shape (L, q, M)."""
    inputs = _zeros(length, terms, total)
    for piece, mine in zip(pieces, places, strict=True):
        values = _part(piece.step.coefficients[piece.run], 0, (mine.stop - mine.start) * length)
        inputs[:, :, mine] = np.moveaxis(values.reshape(-1, length, terms), 0, -1)
    return inputs


def _zeros(*shape: int) -> FloatArray:
    """Zeros placed so that JAX takes them as they are on a CPU; of a long record a copy counts. Never written to."""
    raw = np.zeros(8 * math.prod(shape) + ALIGNED, dtype=np.uint8)
    begin = -raw.ctypes.data % ALIGNED
    return raw[begin : begin + 8 * math.prod(shape)].view(np.float64).reshape(shape)


def _part(values: np.ndarray, begin: int, count: int) -> np.ndarray:
    """``count`` values from ``begin`` on, zero beyond either end."""
    found = np.zeros((count, *values.shape[1:]))
    first, last = max(begin, 0), min(begin + count, values.shape[0])
    if first < last:
        found[first - begin : last - begin] = values[first:last]
    return found

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


@dataclass(frozen=True, eq=False)
class Piece:
    """An unbroken run of steps of one record.

    Attributes:
        record: number of the record.
        run: its samples.
        inputs: of its steps, shape (steps, q).
    """

    record: int
    run: slice
    inputs: FloatArray


def steps_of(
    records: Sequence[Record], method: Method, terms: int, delay_s: float, *, linear: bool
) -> list[StepInputs]:
    """Inputs of every record's steps.

    Args:
        records: the records.
        method: the discretisation.
        terms: inputs a step.
        delay_s: at which the inputs are taken.
        linear: a nonlinear spring depends on its rest position: its reference loses the offset, not the mean
            of a motion that ends within a period.
    """
    return [
        method.inputs(*seen_by_network(record, centred=linear), terms, delay_s * record.sampling_rate_hz)
        for record in records
    ]


def pieces_of(records: Sequence[Record], steps: Sequence[StepInputs], fewest: int) -> list[Piece]:
    """The runs of usable steps that hold more than ``fewest`` samples."""
    return [
        Piece(index, run, step.coefficients[run])
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
    counts = [-(-len(piece.inputs) // length) for piece in pieces]
    total = bucket(sum(counts))  # padded, so that calibrations of about the same size share one compiled program
    inputs, response, weight = (_zeros(*shape) for shape in ((length, terms, total), *[(length, total)] * 2))
    first, segment, rates = np.ones(total, dtype=bool), np.full(total, len(pieces)), np.zeros(total, dtype=int)
    starts = np.cumsum([0, *counts]).tolist()[:-1]
    for number, (piece, count, start) in enumerate(zip(pieces, counts, starts, strict=True)):
        mine, record = slice(start, start + count), records[piece.record]
        mask = record.mask[piece.run]
        weight[:, mine] = _chunks(mask, count, length)
        response[:, mine] = _chunks(record.response[piece.run] * mask, count, length)
        inputs[:, :, mine] = _chunks(piece.inputs, count, length)
        first[mine], segment[mine], rates[mine] = False, number, rate[piece.record]
        first[start] = True
    return Lanes(inputs, response, weight, first, segment, rates), starts


def _zeros(*shape: int) -> FloatArray:
    """Zeros placed so that JAX takes them as they are on a CPU (64 bytes); of a long record a copy counts."""
    raw = np.zeros(8 * math.prod(shape) + 64, dtype=np.uint8)
    begin = -raw.ctypes.data % 64
    return raw[begin : begin + 8 * math.prod(shape)].view(np.float64).reshape(shape)


def _chunks(values: np.ndarray, count: int, length: int) -> np.ndarray:
    """Values of a run, shape (steps, …), as chunks side by side, shape (length, …, count), zero beyond its end."""
    found = np.zeros((count * length, *values.shape[1:]))
    found[: len(values)] = values
    return np.moveaxis(found.reshape(count, length, *values.shape[1:]), 0, -1)

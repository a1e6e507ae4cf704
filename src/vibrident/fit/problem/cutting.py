"""Records cut into lanes of equal length, the input of the unrolled network."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.fit.bins.segments import unbroken
from vibrident.physics.discretisation.inputs import StepInputs
from vibrident.physics.network.unroll import Lanes


class Piece(NamedTuple):
    """An unbroken run of steps of one record: its number, the run's samples, and its first lane."""

    record: int
    run: slice
    lane: int


def bucket(count: int) -> int:
    """The next number of the form m·2ᵏ with 8 ≤ m ≤ 16: at most an eighth more."""
    step = max(1, 1 << (max(count - 1, 1).bit_length() - 4)) if count > 16 else 1
    return -(-count // step) * step


def cut(
    records: Sequence[Record],
    steps: Sequence[StepInputs],
    rate: np.ndarray,
    fewest: int,
    length: int,
) -> tuple[Lanes, list[Piece]]:
    """Cut the runs of usable steps into chunks of ``length``, the last one of each padded with weight zero.

    Args:
        records: the records.
        steps: of each record.
        rate: which sampling interval each record has.
        fewest: a run is used that holds more samples than this.
        length: steps a chunk.
    """
    pieces, total = list[Piece](), 0
    for number, (record, step) in enumerate(zip(records, steps, strict=True)):
        for run in unbroken(step.usable):
            if np.sum(record.mask[run]) > fewest:
                pieces.append(Piece(number, run, total))
                total += -(-(run.stop - run.start) // length)
    ends = [*(piece.lane for piece in pieces), total][1:]
    total = bucket(
        total
    )  # padded, so that calibrations of about the same size share one compiled program
    inputs = _zeros(length, steps[0].coefficients.shape[1], total)
    response, weight = _zeros(length, total), _zeros(length, total)
    first, segment, rates = (
        np.ones(total, dtype=bool),
        np.full(total, len(pieces)),
        np.zeros(total, dtype=int),
    )
    for number, (piece, end) in enumerate(zip(pieces, ends, strict=True)):
        mine, record = slice(piece.lane, end), records[piece.record]
        mask, count = record.mask[piece.run], end - piece.lane
        weight[:, mine] = _chunks(mask, count, length)
        response[:, mine] = _chunks(record.response[piece.run] * mask, count, length)
        inputs[:, :, mine] = _chunks(steps[piece.record].coefficients[piece.run], count, length)
        first[mine], segment[mine], rates[mine] = False, number, rate[piece.record]
        first[piece.lane] = True
    return Lanes(inputs, response, weight, first, segment, rates), pieces


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

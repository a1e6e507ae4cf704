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
    """Unbroken run of steps of one record.

    Attributes:
        record: index of the record.
        run: samples of the run.
        lane: first lane of the run.
    """

    record: int
    run: slice
    lane: int


def bucket(count: int) -> int:
    """Return the next number of the form m·2ᵏ with 8 ≤ m ≤ 16, at most an eighth more."""
    step = max(1, 1 << (max(count - 1, 1).bit_length() - 4)) if count > 16 else 1
    return -(-count // step) * step


def cut(
    records: Sequence[Record],
    steps: Sequence[StepInputs],
    rate: np.ndarray,
    fewest: int,
    length: int,
) -> tuple[Lanes, list[Piece]]:
    """Return the runs of usable steps in chunks, the last one padded with weight zero.

    Args:
        records: the records.
        steps: of each record.
        rate: index of the sampling interval of each record.
        fewest: number of samples that a run must exceed to be used.
        length: steps a chunk.
    """
    pieces: list[Piece] = []
    total = 0
    for number, (record, step) in enumerate(zip(records, steps, strict=True)):
        for run in unbroken(step.usable):
            if np.sum(record.mask[run]) > fewest:
                pieces.append(Piece(number, run, total))
                total += -(-(run.stop - run.start) // length)
    ends = [*(piece.lane for piece in pieces), total][1:]
    # Padded, so that calibrations of about the same size share one compiled program.
    total = bucket(total)
    inputs = _zeros(length, steps[0].coefficients.shape[1], total)
    response = _zeros(length, total)
    weight = _zeros(length, total)
    first = np.ones(total, dtype=bool)
    segment = np.full(total, len(pieces))
    rates = np.zeros(total, dtype=int)
    for number, (piece, end) in enumerate(zip(pieces, ends, strict=True)):
        lanes = slice(piece.lane, end)
        record = records[piece.record]
        mask = record.mask[piece.run]
        count = end - piece.lane
        weight[:, lanes] = _chunks(mask, count, length)
        response[:, lanes] = _chunks(record.response[piece.run] * mask, count, length)
        inputs[:, :, lanes] = _chunks(steps[piece.record].coefficients[piece.run], count, length)
        first[lanes] = False
        segment[lanes] = number
        rates[lanes] = rate[piece.record]
        first[piece.lane] = True
    return Lanes(inputs, response, weight, first, segment, rates), pieces


def _zeros(*shape: int) -> FloatArray:
    """Return zeros aligned to 64 bytes, which JAX takes without a copy on a CPU.

    Of a long record a copy counts.
    """
    raw = np.zeros(8 * math.prod(shape) + 64, dtype=np.uint8)
    begin = -raw.ctypes.data % 64
    return raw[begin : begin + 8 * math.prod(shape)].view(np.float64).reshape(shape)


def _chunks(values: np.ndarray, count: int, length: int) -> np.ndarray:
    """Return values of a run, shape (steps, …), as chunks side by side, shape (length, …, count).

    Zero beyond the end of the run.
    """
    padded = np.zeros((count * length, *values.shape[1:]))
    padded[: len(values)] = values
    return np.moveaxis(padded.reshape(count, length, *values.shape[1:]), 0, -1)

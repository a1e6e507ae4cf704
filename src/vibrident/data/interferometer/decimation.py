"""Decimate and interpolate signals by linear-phase filters, whose delay is known exactly.

Up to 0.4 of the new rate the filters pass to 1e-6; above 0.6 they attenuate to the same part, so
that nothing aliases to below 0.4. They are symmetric; only samples whose filter lies wholly within
the signal are computed.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from vibrident.data.interferometer.setting import BoolArray, FloatArray, Gap, SampledSignals

PASS_EDGE = 0.4  # edge of the pass band over the new rate
STOP_EDGE = 0.6  # edge of the stop band over the new rate
ATTENUATION_DB = 130.0  # attenuation of the stop band, dB
KAISER_BETA = 0.1102 * (
    ATTENUATION_DB - 8.7
)  # shape of Kaiser's window above 50 dB, by his formula
#: Half the filter's length in new sampling intervals: Kaiser's formula.
HALF = int(np.ceil(0.5 * (ATTENUATION_DB - 7.95) / (2.285 * 2.0 * np.pi * (STOP_EDGE - PASS_EDGE))))
BLOCK_SAMPLES = 1 << 17  # samples that are filtered at once
# positions between two samples at which the interpolation filter is tabulated; linear between them
TABULATED_POSITIONS = 4096


@functools.lru_cache(maxsize=8)
def taps(factor: int) -> FloatArray:
    """Return the filter for every ``factor``-th sample, symmetric, of sum one, read-only.

    Shape (2 · HALF · factor + 1,).
    """
    half = HALF * factor
    index = np.arange(-half, half + 1)
    window = np.kaiser(2 * half + 1, KAISER_BETA)
    values = np.sinc(index / factor) * window
    return values / values.sum()


def lost_at_an_end(factor: int) -> int:
    """Return the number of samples before the first new one, which is at this index."""
    return HALF * factor if factor > 1 else 0


def decimated_length(samples: int, factor: int) -> int:
    """Return the number of new samples."""
    if factor == 1:
        return samples
    return max((samples - 2 * HALF * factor - 1) // factor + 1, 0)


class Decimator:
    """Filter that keeps every ``factor``-th sample of signals that come block by block.

    Output sample k is at index ``lost_at_an_end(factor) + k · factor`` of the input.
    """

    def __init__(self, factor: int, signals: int, kernel: np.ndarray) -> None:
        """Take the kernel of :func:`taps`, or that times a complex carrier."""
        self._factor = factor
        self._rows = -(-kernel.shape[0] // factor)
        padded = np.zeros(self._rows * factor, dtype=kernel.dtype)
        padded[: kernel.shape[0]] = kernel
        self._matrix = np.ascontiguousarray(padded.reshape(self._rows, factor).T).view(np.float64)
        self._samples = np.zeros((signals, 0))
        self._partial = np.zeros((signals, 0, self._rows), dtype=kernel.dtype)

    def feed(self, block: FloatArray) -> Any:
        """Return the outputs that a block completes; shape (signals, n) → (signals, any number)."""
        values = np.concatenate([self._samples, block], axis=1)
        rows = values.shape[1] // self._factor
        used = values[:, : rows * self._factor].reshape(values.shape[0], rows, self._factor)
        self._samples = values[:, rows * self._factor :]
        fresh = (used @ self._matrix).view(self._partial.dtype)
        partial = np.concatenate([self._partial, fresh], axis=1)
        ready = max(partial.shape[1] - self._rows + 1, 0)
        self._partial = partial[:, ready:]
        result = np.zeros((values.shape[0], ready), dtype=partial.dtype)
        for j in range(self._rows if ready else 0):
            result += partial[:, j : j + ready, j]
        return result


def decimated(blocks: Iterable[FloatArray], samples: int, factor: int) -> FloatArray:
    """Return the new samples of one signal that comes block by block, each of shape (n,).

    ``samples``: total number of its samples.
    """
    if factor == 1:
        return np.concatenate(list(blocks))
    count = decimated_length(samples, factor)
    return _collected(
        (block[None, :] for block in blocks), Decimator(factor, 1, taps(factor)), (1, count), factor
    )[0]


def filtered(
    raw: SampledSignals, shape: tuple[int, int], factor: int, kernel: np.ndarray, start: int
) -> Any:
    """Return new samples, from ``start`` on, of signals that are read block by block.

    Args:
        raw: the signals.
        shape: (signals, new samples).
        factor: distance of the new samples, in samples of ``raw``.
        kernel: real or complex, shape (2 · HALF · factor + 1,).
        start: first new sample.
    """
    first = start * factor
    last = min((start + shape[1] - 1) * factor + kernel.shape[0], raw.samples)
    blocks = (
        raw.block(begin, min(begin + BLOCK_SAMPLES, last))
        for begin in range(first, last, BLOCK_SAMPLES)
    )
    return _collected(blocks, Decimator(factor, shape[0], kernel), shape, factor)


def _collected(
    blocks: Iterable[FloatArray], decimator: Decimator, shape: tuple[int, int], factor: int
) -> Any:
    values = []
    done = 0
    # The zeros complete the last filter.
    for block in itertools.chain(blocks, [np.zeros((shape[0], factor))]):
        values.append(decimator.feed(block)[:, : shape[1] - done])
        done += values[-1].shape[1]
    return np.concatenate(values, axis=1)


def at_lower_rate(
    raw: SampledSignals, factor: int, block: Callable[[int, int], FloatArray]
) -> SampledSignals:
    """Return signals at a lower rate, whose filtered samples ``block`` computes."""
    first_s = lost_at_an_end(factor) / raw.rate_hz
    return SampledSignals(
        decimated_length(raw.samples, factor), raw.rate_hz / factor, block, first_s
    )


def spoilt_outputs(gaps: Sequence[Gap], samples: int, factor: int) -> BoolArray:
    """Return which new samples have a filter that touches a gap of the input.

    Shape (decimated_length,).
    """
    count = decimated_length(samples, factor)
    bad = np.zeros(count, dtype=bool)
    reach = 2 * lost_at_an_end(factor)
    for gap in gaps:
        first = max(-(-(gap.start - reach) // factor), 0)
        bad[first : (gap.stop - 1) // factor + 1] = True
    return bad


def at_positions(
    values: FloatArray, positions: FloatArray, spacing: float, length: int = HALF
) -> FloatArray:
    """Return a signal at positions between its samples, low-passed for a new rate.

    Args:
        values: shape (n,).
        positions: in samples, shape (m,), from ``reach(spacing)`` to n − 1 − ``reach(spacing)``.
        spacing: of the new samples, in old ones; 1 or more.
        length: half the filter's, in new intervals: a longer one has a narrower transition about
            half the new rate.
    """
    half = reach(spacing, length)
    offsets = np.arange(-half, half + 2)
    interpolated = np.empty(positions.shape[0])
    for begin in range(0, positions.shape[0], 4096):
        block = positions[begin : begin + 4096]
        base, low, high, share = _rows(block, values.shape[0] - 2 - half, spacing, length)
        near = values[np.clip(base[:, None] + offsets, 0, values.shape[0] - 1)]
        below = np.einsum("ij,ij->i", low, near)
        interpolated[begin : begin + 4096] = below + share * (
            np.einsum("ij,ij->i", high, near) - below
        )
    return interpolated


def weights_at(positions: FloatArray, spacing: float, length: int) -> tuple[np.ndarray, FloatArray]:
    """Return the sample before each position, shape (m,), and the weights of the samples around it.

    The weights have shape (m, 2 · half + 2) and are those of samples from ``half`` before that one
    on, with half = ``reach(spacing, length)``; arguments as of :func:`at_positions`.
    """
    base, low, high, share = _rows(positions, np.iinfo(np.int64).max, spacing, length)
    return base, low + share[:, None] * (high - low)


def _rows(
    positions: FloatArray, most: int, spacing: float, length: int
) -> tuple[np.ndarray, FloatArray, FloatArray, FloatArray]:
    """Return the sample before each position, two rows of the table, and the share of the second.

    ``most``: largest index of a sample.
    """
    table = _table(spacing, length)
    base = np.minimum(np.floor(positions).astype(int), most)
    offset = (positions - base) * TABULATED_POSITIONS
    index = np.minimum(offset.astype(int), TABULATED_POSITIONS - 1)
    return base, table[index], table[index + 1], offset - index


def reach(spacing: float, length: int = HALF) -> int:
    """Return the number of samples on either side that :func:`at_positions` needs."""
    return int(np.ceil(length * spacing))


@functools.lru_cache(maxsize=2)
def _table(spacing: float, length: int) -> FloatArray:
    """Return the filter at positions between two samples, a row each; read-only by convention."""
    half = reach(spacing, length)
    distance = (
        np.arange(-half, half + 2)[None, :]
        - (np.arange(TABULATED_POSITIONS + 1) / TABULATED_POSITIONS)[:, None]
    )
    inside = np.clip(1.0 - (distance / half) ** 2, 0.0, None)
    table = np.where(
        np.abs(distance) <= half,
        np.sinc(distance / spacing) * np.i0(KAISER_BETA * np.sqrt(inside)),
        0.0,
    )
    return np.asarray(table / table.sum(axis=1, keepdims=True))

"""Time at which one regime ends and the next begins, by least squares.

Before it the response is that of the first regime's sensor, after it that of the second's, plus
free motion from the state at the change.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy import fft

from vibrident.data.records import FloatArray, Quantity, Record
from vibrident.use.regimes.pieces import PieceEstimate, piece_samples

#: Candidates of a first look; each further one has a finer step.
CANDIDATES = 48


def change_sample(
    record: Record, quantity: Quantity, before: PieceEstimate, behind: PieceEstimate
) -> int:
    """Return the first sample of the second of two regimes that follow each other.

    Args:
        record: the whole record.
        quantity: of the reference.
        before: the first regime; a part of its last piece may be of the second.
        behind: the second, likewise.
    """
    reach = piece_samples(record.samples)
    low = max(before.span.stop - reach, before.span.start)
    high = min(behind.span.start + reach, behind.span.stop)
    residuals = [_residual(record, quantity, regime)[low:high] for regime in (before, behind)]
    free = _free_motion(behind, record.sampling_rate_hz, high - low)
    candidates = np.unique(np.linspace(1, high - low - 1, CANDIDATES).astype(int))
    while True:
        squares = [_squares(index, residuals, free) for index in candidates.tolist()]
        best = int(np.argmin(squares))
        first = candidates[max(best - 1, 0)]
        last = candidates[min(best + 1, len(candidates) - 1)]
        if last - first <= 2:
            return low + int(candidates[best])
        candidates = np.unique(np.linspace(first, last, CANDIDATES).astype(int))


def _squares(index: int, residuals: Sequence[FloatArray], free: FloatArray) -> float:
    """Return the sum of squares of the residual with a change at a sample."""
    before, behind = residuals
    after = behind[index:]
    columns = free[:, : len(after)]
    amounts = np.linalg.lstsq(columns @ columns.T, columns @ after, rcond=None)[0]
    residual = after - amounts @ columns
    start = before[:index]
    return float(start @ start + residual @ residual)


def _residual(record: Record, quantity: Quantity, regime: PieceEstimate) -> FloatArray:
    """Return the response less that of a regime to a motion that recurs, shape (samples,).

    It is zero where a sample is not used.
    """
    assert record.reference is not None
    used = record.mask
    reference = np.where(record.reference_mask, record.reference, 0.0)
    bins = fft.rfft(reference)
    hz = fft.rfftfreq(record.samples, 1.0 / record.sampling_rate_hz)
    hz[0] = hz[1]
    bins[0] = 0.0
    transfer = regime.model.frequency_response(regime.parameters, hz, quantity)
    residual = record.response - fft.irfft(bins * transfer, record.samples)
    return np.asarray(np.where(used, residual - np.median(residual[used]), 0.0))


def _free_motion(regime: PieceEstimate, rate_hz: float, samples: int) -> FloatArray:
    """Return columns of free motion from sample 0 on, and a constant, shape (q, samples)."""
    columns = [np.ones(samples)]
    turns = np.arange(samples) / rate_hz
    for pole in regime.model.poles(regime.parameters):
        if pole.real >= 0.0 or pole.imag < 0.0:
            continue
        wave = np.exp(pole * turns)
        columns += [wave.real, wave.imag] if pole.imag > 0.0 else [wave.real]
    return np.array(columns)

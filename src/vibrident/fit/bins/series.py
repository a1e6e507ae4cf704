"""A run's response and its slopes as signals in time, from the lines of the network.

Needed if samples of the response are missing while the reference continues: no transform of the response exists then,
but the network's does, and what is not used is left out of the sums over its samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.bins.normal import SegmentNormals, horner, modelled_slopes
from vibrident.fit.bins.segments import Segment, shifted_lines
from vibrident.fit.bins.transfer import DiscreteTransfer
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import waves

#: Directions of the initial states that the data show less than this, relative to the best, are left alone.
LEAST_SHOWN = 1e-13


@dataclass(frozen=True, eq=False)
class SegmentSeries:
    """A run of N steps in time, with the initial state and offset that fit its used samples best.

    Attributes:
        predicted: response of the network, shape (N,).
        residual: measured less predicted, zero where the response is not used, shape (N,).
        slopes: of the response with P parameters, initial state held, zero where it is not used, shape (P, N).
        free: what initial states and an offset add, zero where not used, shape (n + 1, N).
        hum: tones that no motion causes, each also growing with time, zero where not used, shape (m, N).
    """

    predicted: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    free: FloatArray
    hum: FloatArray

    def projected_jacobian(self) -> FloatArray:
        """The slopes less what initial states, offset and hum could imitate (Kaufman 1975), shape (P, N)."""
        unknown = np.concatenate([self.free, self.hum])
        share = _least_squares(unknown, self.jacobian.T)
        return self.jacobian - share.T @ unknown


def add_series(normals: SegmentNormals, number: int, series: SegmentSeries) -> None:
    """Write the normal equations of run ``number``, summed over its samples, into those of all."""
    jacobian = series.projected_jacobian()
    normals.matrix[number], normals.gradient[number] = jacobian @ jacobian.T, jacobian @ series.residual
    normals.squares[number] = series.residual @ series.residual


def series_of(segment: Segment, transfer: DiscreteTransfer, slope: DiscreteTransfer) -> SegmentSeries:
    """The network over a segment.

    Args:
        segment: with all of its bins.
        transfer: transfer function of a step.
        slope: its derivatives with P parameters, in a leading axis.
    """
    used: BoolArray = np.ones(segment.samples, dtype=bool) if segment.used is None else segment.used
    w = shifted_lines(segment.samples)
    over = 1.0 / horner(transfer.denominator, w)
    forced = np.zeros_like(over)
    for column, own in zip(transfer.numerator.T, segment.inputs, strict=True):
        forced += horner(column, w) * own
    forced *= over
    shapes = np.stack([(1.0 + w) * over * w**k for k in range(len(transfer.denominator) - 1)])
    whole = np.concatenate([_in_time(shapes, segment.samples), np.ones((1, segment.samples))])
    response, driven = _in_time(np.stack([segment.response, forced]), segment.samples)
    free, hum, n = whole * used, waves(segment.hum, segment.samples) * used, len(whole)
    found = _least_squares(np.concatenate([free, hum]), ((response - driven) * used)[:, None])[:, 0]
    predicted = driven + found[:n] @ whole
    lines = forced + found[: n - 1] @ shapes
    jacobian = modelled_slopes(slope, segment.inputs, lines, w, over)
    residual = (response - predicted) * used - found[n:] @ hum
    return SegmentSeries(predicted, residual, _in_time(jacobian, segment.samples) * used, free, hum)


def _in_time(lines: ComplexArray, samples: int) -> FloatArray:
    return np.asarray(fft.irfft(lines, samples, axis=-1))


def _least_squares(rows: FloatArray, right: FloatArray) -> FloatArray:
    """Least-squares coefficients of ``rows`` (m, N) for the columns of ``right`` (N, k), shape (m, k)."""
    size = np.maximum(np.sqrt(np.sum(rows**2, axis=1)), np.finfo(float).tiny)
    found = np.linalg.lstsq((rows / size[:, None]).T, right, rcond=LEAST_SHOWN)[0]
    return np.asarray(found / size[:, None])

"""Samples predicted from their neighbours: the interpolation that wild samples stand out of."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.transform import median

#: Neighbours on either side.
REACH = 8
#: Rows of a fit, at most.
MOST_ROWS = 4_000
#: Scaled normal equations with eigenvalues above this are solved to six digits.
WELL_POSED = 1e-10
#: Median of the size of normal errors, in standard deviations.
MEDIAN = 0.6745


@dataclass(frozen=True)
class Interpolation:
    """An interpolation fitted to a record.

    Attributes:
        shape: error around a wild sample of size one, shape (2 reach + 1,).
        constant: what it adds.
        deviation: of its errors.
    """

    shape: FloatArray
    constant: float
    deviation: float

    def errors(self, series: FloatArray, judged: BoolArray) -> FloatArray:
        """Error of each sample, shape (samples,); zero where it is not judged."""
        return np.where(judged, np.convolve(series, self.shape, mode="same") - self.constant, 0.0)

    def around(self, error: FloatArray, places: NDArray[np.int_]) -> FloatArray:
        """Usual standard deviation of the errors around some samples, shape (places,)."""
        windows = sliding_window_view(np.pad(np.abs(error), 2 * REACH, mode="reflect"), 4 * REACH + 1)
        return np.maximum(median(windows[places]) / MEDIAN, self.deviation)


#: Order of the rows of a series that is read from its end.
_BACKWARDS = np.append(np.arange(2 * REACH, -1, -1), 2 * REACH + 1)


@dataclass(frozen=True, eq=False)
class Rows:
    """Samples in a row, REACH on either side of those that are predicted, and ones: ``columns``.

    Their shape is (2 reach + 2, rows). Every prediction is of sums of these, so that one matrix of products serves all.
    """

    columns: FloatArray

    @classmethod
    def of(cls, series: FloatArray, clean: BoolArray) -> Rows:
        """Around not too many of the samples that are predicted well."""
        rows = _some(np.flatnonzero(clean) - REACH)
        around = np.ones((2 * REACH + 2, len(series[rows])))
        for shift, column in enumerate(around[:-1]):  # each in a row: windows side by side take four times as long
            column[:] = series[shift:][rows]
        return cls(around)

    def reversed(self) -> Rows:
        """Of the series read from its end."""
        return Rows(self.columns[_BACKWARDS])

    @functools.cached_property
    def gram(self) -> FloatArray:
        """Products of the columns, shape (2 reach + 2, 2 reach + 2)."""
        return self.columns @ self.columns.T

    def fitted(self, sums: FloatArray, wanted: int) -> FloatArray:
        """Amounts of some sums, shape (n, 2 reach + 2), whose sum is closest to the samples ``wanted``.

        By the normal equations, where these lose no digit that counts; a motion without noise leaves them too few.
        """
        gram, moments = sums @ self.gram @ sums.T, sums @ self.gram[wanted]
        size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
        scaled = gram / np.outer(size, size)
        if np.linalg.eigvalsh(scaled)[0] > WELL_POSED:
            return np.asarray(np.linalg.solve(scaled, moments / size) / size, dtype=float)
        samples = self.columns.T
        whole = len(samples) // 8 * 8  # by parts that stay in the processor's cache, and once more of their triangles
        parts = [*np.linalg.qr(samples[:whole].reshape(8, whole // 8, -1), mode="r"), samples[whole:]]
        triangle = np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))
        return np.asarray(np.linalg.lstsq(triangle @ sums.T, triangle[:, wanted], rcond=1e-12)[0], dtype=float)

    def errors(self, sums: FloatArray, wanted: int, amounts: FloatArray) -> FloatArray:
        """What these amounts leave of the samples ``wanted``, shape (rows,)."""
        left = -(amounts @ sums)
        left[wanted] += 1.0
        return left @ self.columns


def interpolation(rows: Rows) -> Interpolation:
    """Fitted to these samples."""
    amounts = rows.fitted(_BESIDE, REACH)
    errors = rows.errors(_BESIDE, REACH, amounts)
    place = int(0.98 * (errors.size - 1))  # so many normal errors are within 2.326 standard deviations
    usual = max(float(np.std(errors)), float(np.partition(np.abs(errors), place)[place]) / 2.326)
    shape = np.concatenate([-amounts[REACH - 1 :: -1], [1.0], -amounts[:REACH]])
    return Interpolation(shape, float(amounts[REACH]), usual)


def _pairs() -> FloatArray:
    """Sums of the neighbours at each distance, and one, shape (reach + 1, 2 reach + 2)."""
    found = np.zeros((REACH + 1, 2 * REACH + 2))
    for k in range(1, REACH + 1):
        found[k - 1, [REACH - k, REACH + k]] = 1.0
    found[REACH, -1] = 1.0
    return found


_BESIDE = _pairs()


def _some(rows: NDArray[np.int_]) -> slice | NDArray[np.int_]:
    """Not too many of the rows, evenly spread; as a slice where none between them is left out."""
    every = max(1, rows.size // MOST_ROWS)
    if rows.size and rows[-1] - rows[0] == rows.size - 1:
        return slice(int(rows[0]), int(rows[-1]) + 1, every)
    return rows[::every]

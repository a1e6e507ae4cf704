"""Linear prediction of a channel, forwards and backwards (autoregression; Vaseghi 2008, ch. 13)."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import extend_flags

#: Order of the autoregression: how many samples predict the next.
ORDER = 16
#: A prediction is fitted to at most MAX_BLOCKS blocks of BLOCK samples.
MAX_BLOCKS = 16
BLOCK_SAMPLES = 256
#: Blocks of a series that are filtered at once.
BLOCKS_AT_ONCE = 1 << 12
#: Places of 2 ORDER + 1 taps, between 2 ORDER zeros on either side, in the matrix of a block and
#: the next one.
_PLACES_OF_TAPS = 2 * ORDER + np.arange(4 * ORDER)[:, None] - np.arange(2 * ORDER)
#: Regularisation of a fit, relative to the trace of its normal matrix: rounding of float64.
RIDGE = 1e-14
#: Errors of noise alone seldom exceed this many standard deviations.
MAX_NOISE_SIGMA = 5.0
#: Median magnitude of normal errors, in standard deviations.
MEDIAN_OF_NORMAL = 0.6745


@dataclass(frozen=True, eq=False)
class LinearPrediction:
    """Linear prediction fitted to a channel.

    Attributes:
        taps: error of the sample after a wild one of size one, and of those after that; shape
            (ORDER + 1,).
        deviation: standard deviation of the errors where the prediction was fitted.
    """

    taps: FloatArray
    deviation: float

    def errors(self, series: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the forward errors and the backward errors of a series, each less its prediction.

        The forward errors lack the first ORDER samples, the backward errors the last ORDER.
        """
        forward = np.convolve(series, self.taps, mode="valid")
        backward = np.convolve(series, self.taps[::-1], mode="valid")
        return forward, backward

    def matched(self, series: FloatArray, has_both_sides: BoolArray) -> FloatArray:
        """Return forward errors matched to a single wild sample, of variance one.

        Shape (samples,); zero where ``has_both_sides`` is False.
        """
        scale = self.deviation * float(np.linalg.norm(self.taps))
        errors = _filtered(series, np.convolve(self.taps, self.taps[::-1]) / scale)
        np.copyto(errors, 0.0, where=~has_both_sides)
        return errors


def _filtered(series: FloatArray, taps: FloatArray) -> FloatArray:
    """Return a series filtered by 2 ORDER + 1 symmetric taps, shape (samples,).

    Blocks of 2 ORDER samples and those after them are multiplied by a matrix of the taps each.
    """
    length = 2 * ORDER
    blocks = -(-series.size // length)
    padded = np.zeros((blocks + 1, length))
    padded.reshape(-1)[ORDER : ORDER + series.size] = series
    matrix = np.concatenate([np.zeros(length), taps, np.zeros(length)])[_PLACES_OF_TAPS]
    products = padded[:-1] @ matrix[:length]
    for begin in range(0, blocks, BLOCKS_AT_ONCE):  # of a long record each copy counts
        following = padded[1 + begin : 1 + begin + BLOCKS_AT_ONCE]
        products[begin : begin + BLOCKS_AT_ONCE] += following @ matrix[length:]
    return products.reshape(-1)[: series.size]


@functools.lru_cache(maxsize=4)
def _blocks(samples: int) -> NDArray[np.int_]:
    """Return the samples of evenly spread blocks, each after ORDER others, shape (blocks, …)."""
    count = samples - ORDER
    if count <= BLOCK_SAMPLES * MAX_BLOCKS:
        return np.arange(samples)[None]
    begins = np.linspace(0, count - BLOCK_SAMPLES, MAX_BLOCKS).astype(int)
    return begins[:, None] + np.arange(BLOCK_SAMPLES + ORDER)


@dataclass(frozen=True, eq=False)
class PredictionSamples:
    """Samples that a prediction is fitted to, with those before them, in blocks of a record.

    Attributes:
        windows: each sample after its ORDER predecessors, shape (ORDER + 1, samples).
        clean: samples to use, shape (samples,).
    """

    windows: FloatArray
    clean: BoolArray

    @classmethod
    def from_series(cls, series: FloatArray, has_past: BoolArray) -> PredictionSamples:
        """Return evenly spread samples of a series, and which of them can be predicted.

        Args:
            series: shape (samples,).
            has_past: which samples come after ORDER valid ones, shape (samples,).
        """
        index = _blocks(series.size)
        length = index.shape[1] - ORDER
        windows = sliding_window_view(series[index], length, axis=1).swapaxes(0, 1)
        return cls(windows.reshape(ORDER + 1, -1), has_past[index[:, ORDER:]].ravel())

    def fit(self) -> LinearPrediction:
        """Return the prediction of least squares, forwards and backwards."""
        windows = self.windows if self.clean.all() else self.windows[:, self.clean]
        products = windows @ windows.T
        products = products + products[::-1, ::-1]
        diagonal = products.reshape(-1)[:: ORDER + 2]
        diagonal += RIDGE * (diagonal.sum() + windows.shape[1])
        weights = np.append(-np.linalg.solve(products[:-1, :-1], products[:-1, -1]), 1.0)
        deviation = float(np.std(weights @ windows))
        return LinearPrediction(weights[::-1], max(deviation, np.finfo(float).eps))

    def without_worst(
        self, prediction: LinearPrediction, rests_mostly: Callable[[], bool]
    ) -> PredictionSamples:
        """Return the samples without those that a wild sample, where errors are large, predicts.

        Returns all samples if no error is large, or if more than half would go: half may lie at
        rest, which says nothing about the motion.

        Args:
            prediction: of all samples.
            rests_mostly: tells whether large errors are where the motion is: then the samples
                before them go, too.
        """
        size = np.abs(prediction.taps[::-1] @ self.windows)
        usual = float(np.median(size[self.clean])) / MEDIAN_OF_NORMAL
        is_large = self.clean & (size > MAX_NOISE_SIGMA * usual)
        if not is_large.any():
            return self
        half = ORDER // 2
        spoilt = (
            extend_flags(is_large, ORDER)
            if rests_mostly()
            else np.pad(extend_flags(is_large, half), (half, 0))[: is_large.size]
        )
        clean = self.clean & ~spoilt
        is_enough = np.sum(clean) > 0.5 * np.sum(self.clean)
        return PredictionSamples(self.windows, clean) if is_enough else self

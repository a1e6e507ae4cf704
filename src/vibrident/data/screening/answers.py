"""Compare a sensor's response with the prediction from its reference: confirm or deny events.

The response is predicted from its past and from the reference (an ARX model; Ljung 1999, ch. 4.2),
so that the beginning, the end and the corners of a motion are no surprise: a sensor answers them.
What is wild in one channel alone leaves an error of known shape and size. Lost time breaks the
prediction.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy import fft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.screening.prediction import (
    BLOCK_SAMPLES,
    MAX_BLOCKS,
    MAX_NOISE_SIGMA,
    MEDIAN_OF_NORMAL,
    ORDER,
    RIDGE,
)
from vibrident.data.screening.wild import (
    MAX_SAMPLES_APART,
    MIN_WILD_SIGMA,
    NEIGHBOURS,
    ChannelEvent,
    PredictedChannel,
)

#: Lags of the autocorrelation that represents the band of a motion.
BAND_LAGS = 2 * ORDER
#: Scatter of a standard deviation that is estimated by the median of n sizes, relative, times √n:
#: 1/√(2 · 0.37), where 0.37 is the efficiency of the median deviation (Hampel 1974).
MEDIAN_SCATTER = 1.17
#: The response breaks off where the prediction is off by more than this share of what follows from
#: its past.
MIN_BREAK = 2e-3
#: A prediction misses less than this share of the response to a motion.
MAX_MISSED_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class PredictedResponse:
    """The response as predicted from its past and from the reference.

    Attributes:
        reference: channel of the reference.
        response: channel of the response.
        delay: samples by which the response comes later than the first of the reference that
            predicts it.
    """

    reference: PredictedChannel
    response: PredictedChannel
    delay: int = 0

    @classmethod
    def all_from_channels(
        cls, reference: PredictedChannel, response: PredictedChannel
    ) -> tuple[PredictedResponse, ...]:
        """Return the best prediction, and those of other delays that are as good within chance.

        The best is found downhill in the delay, from zero and from the delay of the largest
        correlation of both channels.
        """
        correlation = np.abs(_products(reference.series, response.series))[
            : reference.series.size // 2
        ]
        starts = {0, max(int(np.argmax(correlation)) - ORDER // 2, 0)}
        minima = [cls(reference, response, start)._downhill(correlation.size) for start in starts]
        best = min(minima, key=lambda prediction: prediction.deviation)
        scatter = MEDIAN_SCATTER / np.sqrt(max(np.count_nonzero(best._usual), 1))
        limit = best.deviation * (1.0 + MAX_NOISE_SIGMA * scatter)
        return tuple(
            prediction
            for prediction in (best, *best._neighbours(correlation.size), *minima)
            if prediction.deviation <= limit
        )

    def _downhill(self, latest: int) -> PredictedResponse:
        """Return the prediction of a local optimum of the delay, below ``latest``."""
        better = min(
            self._neighbours(latest), key=lambda prediction: prediction.deviation, default=self
        )
        return better._downhill(latest) if better.deviation < self.deviation else self

    def _neighbours(self, latest: int) -> list[PredictedResponse]:
        """Return the predictions of neighbouring delays, below ``latest``."""
        delays = [self.delay + step for step in (-2 * ORDER, -ORDER // 2, ORDER // 2, 2 * ORDER)]
        return [
            PredictedResponse(self.reference, self.response, delay)
            for delay in delays
            if 0 <= delay < latest
        ]

    @functools.cached_property
    def taps(self) -> tuple[FloatArray, FloatArray]:
        """Return the errors that follow a wild sample of size one in reference and response.

        Two arrays, each of shape (ORDER + 1,).
        """
        weights = _prediction_of(self._products_of_usual)
        return weights[ORDER::-1], weights[:ORDER:-1]

    @functools.cached_property
    def _products_of_usual(self) -> FloatArray:
        """Return the products of usual samples, and what predicts them, with each other."""
        usual = np.flatnonzero(self._usual[ORDER:])
        chosen = usual[:: max(1, usual.size // (MAX_BLOCKS * BLOCK_SAMPLES))]
        rows = self._rows(chosen)
        products = rows.T @ rows
        products += RIDGE * (np.trace(products) + len(rows)) * np.eye(len(products))
        return products

    def _rows(self, chosen: NDArray[np.int_] | slice) -> FloatArray:
        """Return what predicts samples after the first ORDER, and these; (n, 2 ORDER + 2)."""
        windows = [
            sliding_window_view(series, ORDER + 1)[chosen]
            for series in (self._delayed, self.response.series)
        ]
        return np.concatenate(windows, axis=1)

    def _goes_with_the_rest(self, span: slice) -> bool:
        """Return whether one prediction explains the samples of a span and the usual ones.

        The usual samples do not tell how the sensor answers what they lack, such as a corner.
        """
        rows = self._rows(slice(span.start - ORDER, span.stop - ORDER))
        weights = _prediction_of(self._products_of_usual + rows.T @ rows)
        near = slice(max(span.start - NEIGHBOURS, ORDER), span.stop + NEIGHBOURS)
        errors = self._rows(slice(near.start - ORDER, near.stop - ORDER)) @ weights
        deviation = self._deviation(errors, near)
        return float(np.max(np.abs(rows @ weights))) < MIN_WILD_SIGMA * deviation

    @functools.cached_property
    def _delayed(self) -> FloatArray:
        """Return the reference shifted by the delay, shape (samples,)."""
        return np.pad(self.reference.series, (self.delay, 0))[: self.reference.series.size]

    @functools.cached_property
    def _usual(self) -> BoolArray:
        """Return which samples have no event of either channel at or before them."""
        usual = (
            self.response.has_past
            & np.pad(self.reference.has_past, (self.delay, 0))[: self.response.has_past.size]
        )
        for channel, delay in ((self.reference, self.delay), (self.response, 0)):
            for event in channel.events:
                first, end = sorted((event.first + delay, event.end + delay))
                usual[max(first - MAX_SAMPLES_APART, 0) : end + ORDER + 1] = False
        return usual

    @functools.cached_property
    def errors(self) -> FloatArray:
        """Return the errors of the prediction, shape (samples,); zero for the first ORDER."""
        contributions = [
            np.convolve(series, taps, "valid")
            for series, taps in zip(self._series, self.taps, strict=True)
        ]
        return np.pad(contributions[0] + contributions[1], (ORDER, 0))

    @property
    def _series(self) -> tuple[FloatArray, FloatArray]:
        return self._delayed, self.response.series

    @functools.cached_property
    def deviation(self) -> float:
        """Return the standard deviation of the errors, by their median."""
        return self._deviation(self.errors, slice(None))

    def _deviation(self, errors: FloatArray, near: slice) -> float:
        """Return the standard deviation of the errors in a span, by the median of usual ones."""
        size = np.abs(errors[self._usual[near]])
        return float(np.median(size)) / MEDIAN_OF_NORMAL if size.size else np.inf

    @functools.cached_property
    def _band_filter(self) -> FloatArray:
        """Return the reference's windowed autocorrelation, a filter of its motion's band.

        Shape (2 BAND_LAGS + 1,).
        """
        later = _products(self.reference.series, self.reference.series)[: BAND_LAGS + 1]
        return np.concatenate([later[:0:-1], later]) * np.hanning(2 * BAND_LAGS + 3)[1:-1]

    def denies(self, label: str, event: ChannelEvent) -> bool:
        """Tell whether a channel's wild samples are no motion, by the errors that they leave.

        The response to the reference is known within the band of its motion alone, so that only
        this band is compared. Where the errors are lost in noise, the wild samples must exceed all
        others of the channel. An event whose response would come after the end of the record is not
        confirmed.
        """
        is_response = label == "response"
        channel = self.response if is_response else self.reference
        sizes = channel.sizes(event)
        effect = np.convolve(sizes, self.taps[is_response])
        first = event.first if is_response else event.first + self.delay
        errors = self.errors
        reach = 0
        if not is_response:
            effect = np.convolve(effect, self._band_filter)
            errors = np.convolve(errors, self._band_filter, mode="same")
            reach = BAND_LAGS
        begin = max(first - reach, ORDER)
        effect = effect[begin - (first - reach) : errors.size - (first - reach)]
        span = slice(begin, begin + effect.size)
        if span.start >= errors.size:  # the record ends before the response
            return True
        around = NEIGHBOURS + 2 * effect.size
        near = slice(max(span.start - around, 0), span.stop + around)
        usual = self._deviation(errors[near], near)
        if float(np.linalg.norm(errors[span])) < MAX_MISSED_SHARE * float(np.linalg.norm(effect)):
            return False
        if float(np.max(np.abs(errors[span]), initial=0.0)) > MIN_WILD_SIGMA * usual:
            is_predicted = is_response and event.first >= ORDER
            return not (is_predicted and self._goes_with_the_rest(span))
        regular_sizes = np.abs(channel.series[~channel.wild])
        return float(np.max(np.abs(sizes))) > float(np.max(regular_sizes))

    def breaks_off(self, index: int) -> bool:
        """Tell whether the response at a sample does not follow from its past and the reference."""
        near = slice(
            max(index - MAX_SAMPLES_APART, ORDER), index + self.delay + ORDER + MAX_SAMPLES_APART
        )
        own_part = np.convolve(
            self.response.series[near.start - ORDER : near.stop], self.taps[1], "valid"
        )
        largest = float(np.max(np.abs(self.errors[near])))
        reach = slice(max(near.start - NEIGHBOURS, 0), near.stop + NEIGHBOURS)
        return largest > max(
            MIN_BREAK * float(np.max(np.abs(own_part))),
            MAX_NOISE_SIGMA * self._deviation(self.errors[reach], reach),
        )


def _prediction_of(products: FloatArray) -> FloatArray:
    """Return the weights of a prediction's error, 1 the last, given the products of its rows."""
    return np.append(-np.linalg.solve(products[:-1, :-1], products[:-1, -1]), 1.0)


def _products(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the sums of products of a series with a later one, for each lag; shape (samples,)."""
    size = 1 << (2 * first.size - 1).bit_length()
    lines = fft.rfft(second, size) * np.conj(fft.rfft(first, size))
    return fft.irfft(lines, size)[: first.size]

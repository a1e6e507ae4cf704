"""Single wild samples (bit errors, contacts that fail, discharges), and places where time was lost.

A sample is predicted from its neighbours on both sides as well as the record's noise and band allow: the interpolation
x[n] ≈ c + Σ a_k (x[n−k] + x[n+k]) is fitted by least squares to the record itself, without the samples that it predicts
worst (Vaseghi 2008, ch. 13). Where noise and motion are the same throughout, its error is the best linear test for a
single wild sample, which leaves an error of one known shape, and nothing once it is taken out. Where motion is faster
than the interpolation (the edge of a shock), the errors of several samples in a row are large, and no single one
explains them.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.rounding import converter_step
from vibrident.fit.response.transform import median
from vibrident.fit.screening.neighbours import MEDIAN, REACH, Interpolation, Rows, interpolation

#: Samples that the interpolation predicts worst, as a part of all, are left out of its fit; rounds of this.
WORST, ROUNDS = 0.015, 4
#: A wild sample, or a break in one of the channels, stands out by so many standard deviations of the errors …
STANDS_OUT = 9.0
#: Noise alone seldom exceeds so many; wild samples exceed them even if they disturb the first fit.
NOISE = 5.0
#: … by more than so many steps of the converter, and this part of the channel's range: rounding.
STEPS, ROUNDING = 4.0, 1e-9
#: With it taken out, the errors around it are at most this part of it.
ISOLATED = 0.3
#: Largest number of wild samples within reach of each other, and their largest part of a record.
IN_A_ROW, MOST = 2, 0.01
#: A corner of the motion looks like a wild sample of at most half the slope beside it; a wild one is so many times it.
CORNER = 0.75
#: What both channels show is so many samples apart at most.
TOGETHER = 2
#: A break is larger than this part of the motion's deviation: smoother changes are its own.
LEAST_BREAK = 2e-3
#: The motion goes on after a break: so many samples on one side of it have this part of the others' deviation, or more.
BESIDE, ALIKE = 64, 0.2


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel to look for wild samples and breaks in.

    Attributes:
        series: about its median, over its largest size, zero where not valid; shape (samples,).
        valid: samples to look at, shape (samples,); neighbours of others are not judged.
        judged: samples with all their neighbours, shape (samples,); all False if there are too few.
    """

    series: FloatArray
    valid: BoolArray
    judged: BoolArray

    @classmethod
    def of(cls, values: FloatArray, valid: BoolArray) -> Channel:
        """A channel; arguments of shape (samples,)."""
        judged = ~_around(~valid, REACH)
        judged[:REACH] = judged[-REACH:] = False
        middle = median(values[valid]) if valid.any() else 0.0
        size = float(np.max(np.abs(values[valid] - middle), initial=0.0))
        if np.sum(judged) < 8 * REACH or size == 0.0:
            return cls(values, valid, np.zeros(values.shape, dtype=bool))
        return cls(np.where(valid, (values - middle) / size, 0.0), valid, judged)

    @functools.cached_property
    def least(self) -> float:
        """Size that a wild sample has at least."""
        return max(STEPS * converter_step(self.series, self.valid), ROUNDING)

    @functools.cached_property
    def _rough(self) -> tuple[Rows, Interpolation, FloatArray]:
        """All samples, the interpolation fitted to them, and its error at each."""
        rows = Rows.of(self.series, self.judged)
        fitted = interpolation(rows)
        return rows, fitted, fitted.errors(self.series, self.judged)

    @functools.cached_property
    def alike(self) -> bool:
        """Whether the errors of the interpolation are those of noise or rounding, which spares a closer look."""
        size = np.abs(self._rough[2])
        above = np.count_nonzero(size > MEDIAN / NOISE * float(np.max(size)))  # half of them are above the median
        return bool(above > 0.5 * np.count_nonzero(self.judged))

    @functools.cached_property
    def clean(self) -> BoolArray:
        """Samples that are predicted well, shape (samples,)."""
        return self.judged if self.alike else _told_well(self.series, self.judged)

    @functools.cached_property
    def long(self) -> Interpolation:
        """The interpolation fitted to these."""
        return self._rough[1] if self.alike else interpolation(Rows.of(self.series, self.clean))

    @functools.cached_property
    def errors(self) -> FloatArray:
        """Error of that interpolation at each sample, shape (samples,); zero where it is not judged."""
        return self._rough[2] if self.alike else self.long.errors(self.series, self.judged)

    @functools.cached_property
    def wild(self) -> BoolArray:
        """Wild samples, shape (samples,)."""
        if not self.judged.any():
            return np.zeros(self.series.shape, dtype=bool)
        series, valid, least = self.series, self.valid, self.least
        sizes = np.zeros(series.shape)
        if self.alike:
            rows = self._rough[0]
        else:
            sizes += _in_the_middle(series, self.judged, self.long, least)
            rows = Rows.of(series - sizes, self.clean)
        beginning = _at_the_beginning(series - sizes, valid, rows, least)
        sizes += beginning
        if beginning.any():
            rows = Rows.of(series - sizes, self.clean)
        sizes += _at_the_beginning((series - sizes)[::-1], valid[::-1], rows.reversed(), least)[::-1]
        return sizes != 0.0


def moves(other: Channel, bad: BoolArray) -> BoolArray:
    """Which wild samples of a channel are motion, shape (samples,): the other channel does something odd there, too.

    A jump of velocity is a pulse of acceleration of a few samples, so the other's differences are looked at as well.

    Args:
        other: the other channel.
        bad: the wild samples, shape (samples,).
    """
    places, moved, series, valid = np.flatnonzero(bad), np.zeros(bad.shape, dtype=bool), other.series, other.valid
    for order in range(3):  # motion of one channel is that of the other up to two derivatives
        if order:
            series, valid = np.diff(series, prepend=series[:1]), valid & np.roll(valid, 1)
            other = Channel.of(series, valid)
        if places.size and other.judged.any():
            far, error = np.zeros(bad.shape), other.errors
            near = np.flatnonzero(_around(bad, TOGETHER + order) & (np.abs(error) > other.least))
            far[near] = np.abs(error[near]) / other.long.around(error, near)
            moved[places] |= _largest_near(far, TOGETHER + order)[places] > NOISE
    return moved


def breaks(first: Channel, second: Channel) -> NDArray[np.int_]:
    """Samples at which both channels of a stationary motion jump: time was lost between them.

    There a few errors in a row stand out of both, and nothing else does. A motion that begins or ends is not a break.
    """
    channels = (first, second)
    if not all(channel.judged.any() for channel in channels):
        return np.zeros(0, dtype=int)
    far = [_far_off(channel) for channel in channels]
    surely = np.maximum(*far) > STANDS_OUT
    if not surely.any():
        return np.zeros(0, dtype=int)
    both = np.minimum(*(_largest_near(f, TOGETHER) for f in far))
    single = _around(first.wild, TOGETHER) & _around(second.wild, TOGETHER)
    places = np.flatnonzero(surely & (both > NOISE) & ~_around(single, REACH))
    rows = _rows_of(places)
    found = [int(row[np.argmax(np.maximum(*far)[row])]) for row in rows if row[-1] - row[0] <= 2 * REACH]
    moving = [place for place in found if all(_moves_on_both_sides(c.series, place) for c in channels)]
    return np.array(moving, dtype=int)


def _far_off(channel: Channel) -> FloatArray:
    """Error of each sample in its usual standard deviation, shape (samples,); zero where it is not significant."""
    long, series = channel.long, channel.series
    error = channel.errors
    least = max(channel.least, LEAST_BREAK * float(np.std(series)))
    places = np.flatnonzero(np.abs(error) > max(NOISE * long.deviation, least))
    far = np.zeros(series.shape)
    if places.size:
        far[places] = np.abs(error[places]) / long.around(error, places)
    return far


def _moves_on_both_sides(series: FloatArray, place: int) -> bool:
    """Whether the motion is about as large before a sample as after it."""
    before = series[max(place - BESIDE - REACH, 0) : place - REACH]
    after = series[place + REACH : place + REACH + BESIDE]
    if min(before.size, after.size) < REACH:
        return False
    sizes = sorted((float(np.std(before)), float(np.std(after))))
    return sizes[0] > ALIKE * sizes[1]


def _in_the_middle(series: FloatArray, judged: BoolArray, long: Interpolation, least: float) -> FloatArray:
    """Size of each wild sample with neighbours on both sides, zero for the others, shape (samples,)."""
    sizes = _sizes(series, judged, long, least)
    rows = _rows_of(np.flatnonzero(sizes * (judged & ~_around(~judged, REACH))))
    kept = np.zeros(series.shape)
    if few := [row for row in rows if row.size <= IN_A_ROW]:
        places = np.concatenate(few)
        after = np.abs(long.errors(series - sizes, judged))
        near = np.max(sliding_window_view(np.pad(after, REACH), 2 * REACH + 1)[places], axis=1)
        isolated = near <= ISOLATED * np.abs(sizes[places])
        slope = np.abs(np.diff(series - sizes, prepend=series[0] - sizes[0], append=series[-1] - sizes[-1]))
        steepest = np.max(sliding_window_view(np.pad(slope, 1), 4)[places], axis=1)
        no_corner = np.abs(sizes[places]) > CORNER * steepest
        kept[places[isolated & no_corner]] = sizes[places[isolated & no_corner]]
    return kept


def _at_the_beginning(series: FloatArray, valid: BoolArray, rows: Rows, least: float) -> FloatArray:
    """Size of each wild sample among the first, predicted from those after it, shape (samples,)."""
    sizes, first = np.zeros(series.shape), 2 * REACH
    if not valid[: 6 * REACH].all():
        return sizes
    prediction = np.eye(first + 1, first + 2, 1)[:first]
    amounts = rows.fitted(prediction, 0)
    inside = np.abs(series[first : 2 * first] - sliding_window_view(series[first + 1 :], first)[:first] @ amounts)
    usual = max(float(np.std(rows.errors(prediction, 0, amounts))), median(inside) / MEDIAN)
    most = max(STANDS_OUT * usual, least)
    errors = series[:first] - sliding_window_view(series[1 : 2 * first], first) @ amounts
    if np.all(np.abs(errors) <= most):
        return sizes
    told = series[: 2 * first].copy()
    for place in range(first - 1, -1, -1):
        errors[place] = told[place] - told[place + 1 : place + 1 + first] @ amounts
        if abs(errors[place]) > most:
            told[place] -= errors[place]
            sizes[place] = errors[place]
    places = np.flatnonzero(sizes)
    # The prediction of a motion that settles becomes worse towards its beginning.
    if places.size == 0 or places.size > IN_A_ROW or places[0] < 2:
        return np.zeros(series.shape)
    before = float(np.max(np.abs(errors[: places[0]])))
    return sizes if before <= ISOLATED * float(np.min(np.abs(sizes[places]))) else np.zeros(series.shape)


def _around(flags: BoolArray, reach: int) -> BoolArray:
    if not flags.any():
        return np.zeros(flags.shape, dtype=bool)
    count = np.cumsum(np.pad(flags, (reach + 1, reach)))
    return count[2 * reach + 1 :] > count[: -2 * reach - 1]


def _largest_near(values: FloatArray, reach: int) -> FloatArray:
    """Largest of the values within reach, none of them negative; shape (samples,)."""
    padded = np.pad(values, reach)
    found = values.copy()
    for shift in range(2 * reach + 1):
        np.maximum(found, padded[shift : shift + len(values)], out=found)
    return found


def _told_well(series: FloatArray, judged: BoolArray) -> BoolArray:
    """Samples far from those that an interpolation fitted to the others tells worst."""
    clean = judged
    worst = max(3, int(WORST * np.sum(judged)))
    for _ in range(ROUNDS):
        error = np.abs(interpolation(Rows.of(series, clean)).errors(series, judged))
        peaks = np.flatnonzero(error * (error >= _largest_near(error, 2)))
        far = np.zeros(series.shape, dtype=bool)
        far[peaks[np.argpartition(error[peaks], -worst)[-worst:]] if peaks.size > worst else peaks] = True
        clean = judged & ~_around(far, REACH)
        if np.sum(clean) < 8 * REACH:
            return judged
    return clean


def _sizes(series: FloatArray, judged: BoolArray, long: Interpolation, least: float) -> FloatArray:
    """Size of each sample that may be wild, zero for the others; all zero where there are too many."""
    sizes = np.zeros(series.shape)
    for _ in range(24):  # the largest of neighbours first
        error = long.errors(series - sizes, judged)
        sizes += np.where(sizes == 0.0, 0.0, error)
        size = np.abs(error)
        places = np.flatnonzero((sizes == 0.0) & (size > max(STANDS_OUT * long.deviation, least)))
        places = places[size[places] > STANDS_OUT * long.around(error, places)]
        if places.size == 0:
            return sizes
        highest = sliding_window_view(np.pad(size, REACH), 2 * REACH + 1)[places]
        places = places[size[places] == np.max(highest, axis=1)]
        sizes[places] = error[places]
        if np.count_nonzero(sizes) > max(4, int(MOST * series.size)):
            return np.zeros(series.shape)
    return sizes


def _rows_of(places: NDArray[np.int_]) -> list[NDArray[np.int_]]:
    """The places, those within reach of each other together."""
    return np.split(places, np.flatnonzero(np.diff(places) > REACH) + 1) if places.size else []

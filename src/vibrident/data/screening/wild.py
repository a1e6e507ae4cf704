"""Find wild samples (bit errors, failing contacts, slipped buffers) and breaks where time was lost.

A channel is predicted from the samples before each one and, with the same coefficients, from those
after it (autoregression; Vaseghi 2008, ch. 13). Both errors are noise where the motion goes on as
elsewhere. The forward error first stands out at the first sample that its past does not explain,
the backward error last stands out at the last sample that its future does not explain. The samples
from the first to the last of these are wild. Where none lies between them, the motion broke off and
went on elsewhere, began, or has a corner.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import distinct, extend_flags, runs_of_true
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.prediction import (
    MAX_NOISE_SIGMA,
    MEDIAN_OF_NORMAL,
    ORDER,
    LinearPrediction,
    PredictionSamples,
)
from vibrident.data.screening.steps import converter_step

#: Refits without the samples that the previous fit did not explain.
REFITS = 3
#: Wild samples and breaks exceed this many standard deviations.
MIN_WILD_SIGMA = 9.0
#: Wild samples are larger than MIN_STEPS steps of the converter, and than this share of the
#: channel's range: rounding.
MIN_STEPS = 4.0
MIN_RELATIVE_SIZE = 1e-7
#: Differences of this order tell rough from smooth.
ROUGHNESS_ORDER = 3
#: A channel rests where half its samples are nearer to its median than this share of its range.
MAX_REST = 1e-3
#: Longest run of wild samples where a reference shows the motion.
MAX_RUN_SAMPLES = 40
#: The same where events are longer.
MAX_LONG_RUN_SAMPLES = 400
#: Longest run of wild samples without a reference.
MAX_SHORT_RUN_SAMPLES = 2
#: Samples next to a longer run that are probably wild, too, but not far enough off to show it.
GUARD_SAMPLES = 4
#: Largest number of wild runs over the number of samples; more of them are the channel's nature.
MAX_WILD_SHARE = 0.01
#: Samples on either side that show the usual size of errors, in addition to those that a run of
#: wild samples disturbs.
NEIGHBOURS = 40
#: Largest distance, in samples, of the same event in both channels.
MAX_SAMPLES_APART = 2
#: A break is larger than this share of the usual step between samples, as a sample at least is
#: lost; smaller ones are corners of the motion, where a burst has faded in.
MIN_BREAK_STEPS = 0.2
#: The motion goes on after a break: of SIDE_SAMPLES on either side, the smaller standard
#: deviation is at least MIN_DEVIATION_RATIO times the larger one.
SIDE_SAMPLES = 64
MIN_DEVIATION_RATIO = 0.2

#: Samples before and after an event that may be wild, too, the fewest first.
_EXTENSIONS = sorted(itertools.product(range(GUARD_SAMPLES), repeat=2), key=sum)


@dataclass(frozen=True)
class ChannelEvent:
    """Event: samples at which a channel does not go on as predicted.

    Attributes:
        first: first sample that its past does not explain.
        end: one more than the last sample that its future does not explain.
        strength: largest error, in its standard deviation.
        lone: whether wild samples from ``first`` to ``end`` explain the whole event.
        wild: whether those samples exceed the noise, too.
    """

    first: int
    end: int
    strength: float
    lone: bool
    wild: bool

    @property
    def may_be_wild(self) -> bool:
        """Return whether wild samples alone may explain the event."""
        return self.lone or self.strength < MIN_WILD_SIGMA

    @property
    def may_be_short_wild(self) -> bool:
        """Return whether one or two wild samples may explain the event."""
        return self.may_be_wild and self.end - self.first <= MAX_SHORT_RUN_SAMPLES

    @property
    def is_abrupt(self) -> bool:
        """Return whether at most two samples lie between those that either side explains."""
        return not self.wild and self.end - self.first <= MAX_SHORT_RUN_SAMPLES

    def meets(self, event: ChannelEvent) -> bool:
        """Return whether another channel's event happens at the same time."""
        (low, high), (event_low, event_high) = (
            sorted((channel_event.first, channel_event.end)) for channel_event in (self, event)
        )
        return low <= event_high + MAX_SAMPLES_APART and event_low <= high + MAX_SAMPLES_APART


@dataclass(frozen=True, eq=False)
class PredictedChannel:
    """A channel and the errors of its prediction.

    Attributes:
        samples: the channel.
        size: largest size of its samples about their median.
        series: the samples about their median, over that size, zero where not valid; shape
            (samples,).
        max_run_samples: longest run of wild samples to look for.
    """

    samples: ChannelSamples
    size: float
    series: FloatArray
    max_run_samples: int = MAX_SHORT_RUN_SAMPLES

    @classmethod
    def from_samples(
        cls, channel: ChannelSamples, max_run_samples: int = MAX_SHORT_RUN_SAMPLES
    ) -> PredictedChannel:
        """Scale a channel's samples, and set those that are not valid to zero."""
        middle = channel.middle
        size = float(np.max(np.abs(channel.ordered[[0, -1]] - middle))) if channel.span else 1.0
        series = (channel.values - middle) / size
        if not channel.all_valid:
            series = np.where(channel.valid, series, 0.0)
        return cls(channel, size, series, max_run_samples)

    @property
    def valid(self) -> BoolArray:
        """Return which samples to look at, shape (samples,)."""
        return self.samples.valid

    @functools.cached_property
    def has_past(self) -> BoolArray:
        """Return which samples come after ORDER valid ones, shape (samples,)."""
        half = ORDER // 2
        has_past = ~extend_flags(~self.valid, half)[half : self.valid.size - half]
        return np.concatenate([np.zeros(ORDER, dtype=bool), has_past])

    @functools.cached_property
    def has_both_sides(self) -> BoolArray:
        """Return which samples have ORDER valid ones on both sides, shape (samples,)."""
        return self.has_past & np.concatenate([self.has_past[ORDER:], np.zeros(ORDER, dtype=bool)])

    @functools.cached_property
    def is_readable(self) -> bool:
        """Return whether the channel has enough valid samples to judge."""
        enough = np.count_nonzero(self.has_both_sides) >= 8 * ORDER
        return bool(enough and self.series.any())

    @functools.cached_property
    def step(self) -> float:
        """Return the converter's step in units of the series; zero where none is seen."""
        return converter_step(self.samples.values, self.valid) / self.size

    @property
    def min_wild_size(self) -> float:
        """Return the smallest size that a wild sample can have, in units of the series."""
        return max(MIN_STEPS * self.step, MIN_RELATIVE_SIZE)

    @functools.cached_property
    def prediction(self) -> LinearPrediction:
        """Return the prediction fitted to the samples that it explains well."""
        return self._fitted[0]

    @functools.cached_property
    def _fitted(self) -> tuple[LinearPrediction, FloatArray]:
        """Return the prediction, and its errors matched to a wild sample."""
        samples = PredictionSamples.from_series(self.series, self.has_past)
        prediction = samples.fit()
        for _ in range(REFITS):
            usual = samples.without_worst(prediction, lambda: self.is_mostly_at_rest)
            if usual is samples:
                break
            prediction = usual.fit()
        return prediction, prediction.matched(self.series, self.has_both_sides)

    @functools.cached_property
    def errors(self) -> FloatArray:
        """Return the errors matched to a single wild sample, in standard deviations.

        Shape (samples,); zero without ORDER valid samples on both sides.
        """
        return self._fitted[1]

    def usual_size(self, index: NDArray[np.int_]) -> FloatArray:
        """Return the usual size of the errors around samples, in standard deviations; 1 or more.

        It is that of rounding at least, whose errors a motion in step with the sampling repeats: a
        prediction knows them until another motion is added.
        """
        # Wild samples disturb less than a third of these.
        reach = NEIGHBOURS + 2 * self.max_run_samples
        last = self.errors.size - 1
        around = np.abs(index[:, None] + np.arange(-reach, reach + 1)) % (2 * last)
        size = np.abs(self.errors[last - np.abs(last - around)])  # mirrored at the ends
        rounding = self.step / np.sqrt(12.0) * float(np.linalg.norm(self.prediction.taps))
        least = max(1.0, rounding / self.prediction.deviation)
        return np.maximum(np.median(size, axis=1) / MEDIAN_OF_NORMAL, least)

    @functools.cached_property
    def events(self) -> tuple[ChannelEvent, ...]:
        """Return the places where the channel does not go on as predicted; none if too many.

        Those at its ends are sought with longer runs alone: what lies beyond is not known.
        """
        if not self.is_readable:
            return ()
        at_ends = self.max_run_samples > MAX_SHORT_RUN_SAMPLES
        return (*self._inner_events, *(self._end_events() if at_ends else ()))

    def _end_events(self) -> Iterator[ChannelEvent]:
        """Yield the runs from the begin, and to the end, that the samples beside do not explain.

        A sensor that begins at rest, or with free motion, is not explained either.
        """
        samples = self.series.size
        for is_begin in (True, False):
            reach = min(self.max_run_samples, MAX_RUN_SAMPLES) + 2 * ORDER
            near = slice(0, reach) if is_begin else slice(samples - reach, samples)
            if samples < 2 * reach or not self.valid[near].all():
                continue
            errors = self.prediction.errors(self.series[near])[is_begin]
            size = np.abs(errors[::-1] if is_begin else errors)  # towards the end
            inner = reach if is_begin else samples - reach
            usual = float(self.usual_size(np.array([inner]))[0]) * self.prediction.deviation
            odd = np.flatnonzero(size > MAX_NOISE_SIGMA * usual)
            strength = float(np.max(size)) / usual
            if odd.size and odd[0] >= ORDER and strength > MIN_WILD_SIGMA:
                length = size.size - int(odd[0])
                run = slice(0, length) if is_begin else slice(samples - length, samples)
                yield ChannelEvent(run.start, run.stop, strength, lone=True, wild=True)

    @functools.cached_property
    def _inner_events(self) -> tuple[ChannelEvent, ...]:
        """Return the events with enough samples on both sides."""
        size = np.abs(self.errors)
        index = np.flatnonzero(size > MAX_NOISE_SIGMA)
        if not index.size:
            return ()
        level = self.usual_size(index)
        significant = size[index] > MAX_NOISE_SIGMA * level
        index = index[significant]
        level = level[significant]
        groups = np.split(np.arange(index.size), np.flatnonzero(np.diff(index) > ORDER) + 1)
        if not index.size or len(groups) > max(8, MAX_WILD_SHARE * size.size):
            return ()
        events = (self._events_at(index[group], float(np.max(level[group]))) for group in groups)
        return tuple(itertools.chain.from_iterable(events))

    def _events_at(self, index: NDArray[np.int_], level: float) -> tuple[ChannelEvent, ...]:
        """Return the events at samples next to each other; none next to invalid samples."""
        low = max(int(index[0]) - ORDER, ORDER)
        high = min(int(index[-1]) + ORDER + 1, self.valid.size - ORDER)
        if not self.valid[low - ORDER : high + ORDER].all():
            return ()
        usual = level * self.prediction.deviation
        peak = int(index[np.argmax(np.abs(self.errors[index]))])
        forward, backward = self.prediction.errors(self.series[low - ORDER : high + ORDER])
        without_past = np.flatnonzero(np.abs(forward[:-ORDER]) > MAX_NOISE_SIGMA * usual)
        without_future = np.flatnonzero(np.abs(backward[ORDER:]) > MAX_NOISE_SIGMA * usual)
        first = low + int(without_past[0]) if without_past.size else peak
        end = low + int(without_future[-1]) + 1 if without_future.size else peak + 1
        if first == low or end == high:  # the event reaches beyond the samples that can be judged
            return ()
        strength = float(np.abs(self.errors[peak])) / level
        around_peak = [(peak, peak + 1), (peak, peak + 2), (peak - 1, peak + 1)]
        candidates = around_peak
        if end > first:
            candidates = [(first - before, end + after) for before, after in _EXTENSIONS]
        for begin, stop in candidates:
            if begin < low or stop - begin > self.max_run_samples:
                break
            errors = forward[begin - low : stop - low + ORDER]
            lone, wild = self._explained(errors, usual, stop - begin)
            # A corner of the motion looks much like a wild sample that neither error shows.
            if lone and not (self.is_mostly_at_rest and self._is_smooth(begin, stop)):
                return (ChannelEvent(begin, stop, strength, lone, wild and end > first),)
        motion = ChannelEvent(first, end, strength, lone=False, wild=False)
        for begin, stop in around_peak:
            if self._is_far_off(begin, stop):
                wild_event = ChannelEvent(begin, stop, strength, lone=True, wild=True)
                return (wild_event,) if motion.is_abrupt else (wild_event, motion)
        return (motion,)

    @functools.cached_property
    def is_mostly_at_rest(self) -> bool:
        """Return whether the channel rests for most of the record, and a prediction fits that."""
        return float(np.median(np.abs(self.series))) < MAX_REST

    def _is_smooth(self, begin: int, stop: int) -> bool:
        """Return whether samples are as smooth as their neighbours, as tops of pulses are."""
        roughness = np.abs(np.diff(self.series[begin - ORDER : stop + ORDER], n=ROUGHNESS_ORDER))
        margin = ORDER - ROUGHNESS_ORDER
        usual = max(float(np.max(roughness[:margin])), float(np.max(roughness[-margin:])))
        return float(np.max(roughness)) < MIN_WILD_SIGMA * usual

    def _is_far_off(self, begin: int, stop: int) -> bool:
        """Return whether samples lie far off a motion that no prediction explains.

        The scale is the largest change between neighbouring samples of that motion.
        """
        past = np.arange(max(begin - ORDER, 0), begin)
        future = np.arange(stop, min(stop + ORDER, self.series.size))
        neighbours = np.append(past, future)
        index = np.arange(begin, stop)
        deviation = self.series[index] - np.interp(index, neighbours, self.series[neighbours])
        change = float(np.max(np.abs(np.diff(self.series[neighbours]))))
        limit = max(MIN_WILD_SIGMA * change, self.min_wild_size)
        return float(np.min(np.abs(deviation))) > limit

    def _explained(self, errors: FloatArray, usual: float, length: int) -> tuple[bool, bool]:
        """Return whether wild samples may explain the forward errors, and whether they surely do.

        Args:
            errors: forward errors from the first of these samples on.
            usual: standard deviation of the errors.
            length: number of wild samples.
        """
        sizes, remainder = self._fit_wild_sizes(errors, length)
        reduction = float(errors @ errors - remainder @ remainder) / usual**2
        lone = (
            float(np.max(np.abs(remainder))) <= MAX_NOISE_SIGMA * usual
            and float(np.max(np.abs(sizes))) > self.min_wild_size
        )
        return lone, lone and reduction > MIN_WILD_SIGMA**2 + length

    def _fit_wild_sizes(self, errors: FloatArray, length: int) -> tuple[FloatArray, FloatArray]:
        """Return by how much the first ``length`` samples are off, and the errors that remain."""
        taps = np.pad(self.prediction.taps, (length - 1, max(errors.size - ORDER - 1, 0)))
        design = sliding_window_view(taps[: errors.size + length - 1], errors.size)[::-1].T
        sizes = np.asarray(np.linalg.lstsq(design, errors, rcond=None)[0], dtype=np.float64)
        return sizes, errors - design @ sizes

    def prominence(self, span: slice) -> float:
        """Return the largest size of the samples in a span over that of all others."""
        size = np.abs(self.series)
        largest_elsewhere = max(
            float(np.max(size[: span.start], initial=0.0)),
            float(np.max(size[span.stop :], initial=0.0)),
        )
        largest = float(np.max(size[span], initial=0.0))
        return largest / max(largest_elsewhere, np.finfo(float).tiny)

    def sizes(self, event: ChannelEvent) -> FloatArray:
        """Return by how much wild samples differ from the prediction of their neighbours."""
        if event.first == 0:
            backward = self.prediction.errors(self.series[: event.end + ORDER])[1]
            return self._fit_wild_sizes(backward[::-1], event.end)[0][::-1]
        errors = self.prediction.errors(self.series[event.first - ORDER : event.end + ORDER])[0]
        return self._fit_wild_sizes(errors, event.end - event.first)[0]

    @functools.cached_property
    def wild(self) -> BoolArray:
        """Return the wild samples, shape (samples,)."""
        flags = np.zeros(self.series.shape, dtype=bool)
        if self.is_readable:
            runs = [event for event in self.events if event.wild]
            for run in runs if len(runs) <= max(4, MAX_WILD_SHARE * flags.size) else []:
                guard = GUARD_SAMPLES * (run.end - run.first > MAX_SHORT_RUN_SAMPLES)
                flags[max(run.first - guard, 0) : run.end + guard] = True
        return flags


def find_motion(
    channel: PredictedChannel, other_channel: PredictedChannel, bad: BoolArray
) -> BoolArray:
    """Return which odd samples are motion, as the other channel shows an event there, too.

    A jump of velocity is a pulse of acceleration of a few samples, so the other channel's first and
    second differences are compared as well. An event of the other channel that begins before one or
    two odd samples and ends after them does not explain them where they stand out more than it.

    Args:
        channel: the channel with odd samples.
        other_channel: the channel to compare with.
        bad: the odd samples, shape (samples,).

    Returns:
        shape (samples,).
    """
    is_motion = np.zeros(bad.shape, dtype=bool)
    if not bad.any():
        return is_motion
    short_runs = [
        slice(first, end)
        for first, end in zip(*runs_of_true(bad), strict=True)
        if end - first <= MAX_SHORT_RUN_SAMPLES
    ]
    for order in range(3):  # motion of one channel is that of the other up to two derivatives
        if order:
            series = np.diff(other_channel.series, prepend=other_channel.series[:1])
            valid = other_channel.valid & np.roll(other_channel.valid, 1)
            other_channel = PredictedChannel.from_samples(ChannelSamples(series, valid))
        if not other_channel.is_readable:
            continue
        reach = MAX_SAMPLES_APART + order
        near = np.flatnonzero(extend_flags(bad, reach))
        limit = MAX_NOISE_SIGMA * other_channel.usual_size(near)
        is_odd = np.zeros(bad.shape, dtype=bool)
        is_odd[near] = np.abs(other_channel.errors[near]) > limit
        is_amid_event = np.zeros(bad.shape, dtype=bool)
        for event in other_channel.events:
            is_amid_event[event.first + reach + 1 : max(event.end - reach - 1, 0)] = True
        explained = extend_flags(is_odd, reach)
        for run in short_runs:
            around = slice(max(run.start - reach, 0), run.stop + reach)
            stands_out = channel.prominence(run) > other_channel.prominence(around)
            explained[run] &= ~(is_amid_event[run] & stands_out)
        is_motion |= bad & explained
    return is_motion


def find_breaks(reference: PredictedChannel, response: PredictedChannel) -> NDArray[np.int_]:
    """Return the samples at which both channels of a stationary motion jump: time was lost there.

    Both channels go on elsewhere, no wild samples explain that, and nothing lies between the motion
    before and after: a knock would last. The begin or end of a motion is not a break, nor is one of
    several breaks close together, where the sensor was moved.
    """
    candidates = []
    for event in reference.events:
        for answer in filter(event.meets, response.events):
            strongest = max(event, answer, key=lambda candidate: candidate.strength)
            if (
                strongest.strength > MIN_WILD_SIGMA
                and not (event.may_be_wild and answer.may_be_wild)
                and event.is_abrupt
                and answer.is_abrupt
                and _is_break(reference, strongest.first)
                and _is_break(response, strongest.first)
            ):
                candidates.append(strongest.first)
    breaks = distinct(np.array(candidates, dtype=int))
    distances = np.diff(breaks, prepend=-SIDE_SAMPLES, append=reference.valid.size + SIDE_SAMPLES)
    return breaks[(distances[:-1] >= SIDE_SAMPLES) & (distances[1:] >= SIDE_SAMPLES)]


def _is_break(channel: PredictedChannel, index: int) -> bool:
    """Return whether a channel jumps at a sample between motions of about the same size."""
    series = channel.series
    errors, _ = channel.prediction.errors(series[max(index - 2 * ORDER, 0) : index + 2 * ORDER])
    past = series[max(index - SIDE_SAMPLES - ORDER, 0) : index]
    future = series[index : index + ORDER + SIDE_SAMPLES]
    if min(past.size, future.size) < ORDER:
        return False
    if float(np.max(np.abs(errors))) < MIN_BREAK_STEPS * float(np.std(np.diff(series))):
        return False
    smaller, larger = sorted((float(np.std(past)), float(np.std(future))))
    return smaller > MIN_DEVIATION_RATIO * larger

"""Wild samples (bit errors, failing contacts, slipped buffers) and places where a recorder lost time.

A channel is predicted from the samples before each one and, with the same coefficients, from those
after it (autoregression; Vaseghi 2008, ch. 13). Both errors are noise where the motion goes on as
elsewhere. The forward error first stands out at the first sample that those before it do not
explain, the backward error last at the last sample that those after it do not explain. So the
samples from the one to the other are wild; where none lies between them, the motion broke off and
went on elsewhere, began, or has a corner.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import runs_of_true
from vibrident.data.screening.steps import converter_step

#: Samples that predict one.
ORDER = 16
#: A prediction is fitted to at most so many blocks of so many samples.
MAX_BLOCKS = 16
BLOCK = 256
#: What is added to the products of a fit, as a part of their sum: rounding of double precision.
RIDGE = 1e-14
#: Rounds of a fit without what it does not explain.
ROUNDS = 3
#: Wild samples and breaks stand out by so many standard deviations; noise alone seldom exceeds
#: NOISE of them.
STANDS_OUT = 9.0
NOISE = 5.0
#: Wild samples are larger than so many steps of the converter, and this part of the channel's
#: range: rounding.
MIN_STEPS = 4.0
MIN_SIZE = 1e-7
#: Longest run of wild samples where a reference shows what is motion, and where nothing does.
MAX_RUN = 40
MAX_SHORT_RUN = 2
#: Samples beside a longer run that are as likely wild, only not far enough off to show it.
GUARD = 4
#: Largest number of wild runs, as a part of the samples; more are the channel's nature.
MAX_SHARE = 0.01
#: Samples on either side that show how large errors usually are, beside those that a run of wild
#: ones disturbs.
NEAR = 40
#: Median of the size of normal errors, in standard deviations.
MEDIAN = 0.6745
#: What both channels show is so many samples apart at most.
TOGETHER = 2
#: A break is larger than this part of the motion's deviation: smoother changes are its own.
MIN_BREAK = 2e-3
#: The motion goes on after a break: so many samples on one side have this part of the others'
#: deviation, or more.
BESIDE = 64
ALIKE = 0.2


_WIDER = sorted(((left, right) for left in range(GUARD) for right in range(GUARD)), key=sum)


@dataclass(frozen=True)
class Event:
    """A place where a channel does not go on as predicted.

    Attributes:
        first: first sample that those before it do not explain.
        end: sample behind the last that those after it do not explain.
        strength: largest error, in its standard deviation.
        lone: whether wild samples from ``first`` to ``end`` explain all that is odd.
        wild: whether they stand out of the noise, too.
    """

    first: int
    end: int
    strength: float
    lone: bool
    wild: bool

    @property
    def plain(self) -> bool:
        """Whether wild samples may be all there is."""
        return self.lone or self.strength < STANDS_OUT

    @property
    def brief(self) -> bool:
        """Whether a wild sample or two may be all there is."""
        return self.plain and self.end - self.first <= MAX_SHORT_RUN

    @property
    def torn(self) -> bool:
        """Whether hardly a sample lies between what those before and those after it explain."""
        return not self.wild and self.end - self.first <= MAX_SHORT_RUN

    def meets(self, other: Event) -> bool:
        """Tell whether two channels show something at the same time."""
        (low, high), (other_low, other_high) = (
            sorted((each.first, each.end)) for each in (self, other)
        )
        return low <= other_high + TOGETHER and other_low <= high + TOGETHER


@dataclass(frozen=True, eq=False)
class Channel:
    """A channel and the errors of its prediction.

    Attributes:
        series: about its median, over its largest size, zero where not valid; shape (samples,).
        valid: samples to look at, shape (samples,).
        longest: longest run of wild samples.
    """

    series: FloatArray
    valid: BoolArray
    longest: int = MAX_SHORT_RUN

    @classmethod
    def from_values(
        cls, values: FloatArray, valid: BoolArray, longest: int = MAX_SHORT_RUN
    ) -> Channel:
        """Return the channel of some values, shape (samples,), as far as they are ``valid``."""
        middle = float(np.median(values[valid])) if valid.any() else 0.0
        size = float(np.max(np.abs(values[valid] - middle), initial=0.0))
        return cls(np.where(valid, (values - middle) / (size or 1.0), 0.0), valid, longest)

    @functools.cached_property
    def follows(self) -> BoolArray:
        """Samples that ORDER valid ones precede, shape (samples,)."""
        bad = np.cumsum(np.concatenate([[0], ~self.valid]))
        return np.concatenate([np.zeros(ORDER, dtype=bool), bad[ORDER + 1 :] == bad[: -ORDER - 1]])

    @functools.cached_property
    def judged(self) -> BoolArray:
        """Samples with ORDER valid ones on both sides, shape (samples,)."""
        return self.follows & np.concatenate([self.follows[ORDER:], np.zeros(ORDER, dtype=bool)])

    @functools.cached_property
    def readable(self) -> bool:
        """Whether there is enough to judge."""
        return bool(
            self.valid.size > 8 * ORDER and np.sum(self.judged) >= 8 * ORDER and np.any(self.series)
        )

    @functools.cached_property
    def smallest(self) -> float:
        """Least size of a wild sample."""
        return max(MIN_STEPS * converter_step(self.series, self.valid), MIN_SIZE)

    @functools.cached_property
    def prediction(self) -> Prediction:
        """The prediction fitted to the samples that it explains well."""
        return self._fitted[0]

    @functools.cached_property
    def _fitted(self) -> tuple[Prediction, FloatArray]:
        """The prediction, and its errors matched to a wild sample; these are noise or rounding where it is the first.

        Then the largest is below NOISE standard deviations, and half of them are above the median.
        """
        samples = Samples.from_series(self.series, self.follows)
        prediction = samples.fit()
        errors = prediction.matched(self.series, self.judged)
        size = np.abs(errors)
        if np.count_nonzero(size > MEDIAN / NOISE * np.max(size)) > 0.5 * np.count_nonzero(
            self.judged
        ):
            return prediction, errors
        for _ in range(ROUNDS):
            prediction = samples.without_worst(prediction).fit()
        return prediction, prediction.matched(self.series, self.judged)

    @functools.cached_property
    def errors(self) -> FloatArray:
        """Errors matched to a single wild sample in standard deviations, shape (samples,); zero where not judged."""
        return self._fitted[1]

    def level(self, places: NDArray[np.int_]) -> FloatArray:
        """Return the usual size of the errors around some samples in standard deviations, at least one."""
        reach = NEAR + 2 * self.longest  # less than a third of the samples are disturbed
        around = sliding_window_view(
            np.pad(np.abs(self.errors), reach, mode="reflect"), 2 * reach + 1
        )
        return np.maximum(np.median(around[places], axis=1) / MEDIAN, 1.0)

    @functools.cached_property
    def events(self) -> tuple[Event, ...]:
        """Places where the channel does not go on as predicted; none where there are too many."""
        if not self.readable:
            return ()
        size = np.abs(self.errors)
        places = np.flatnonzero(size > NOISE)
        if not places.size:
            return ()
        level = self.level(places)
        places, level = places[size[places] > NOISE * level], level[size[places] > NOISE * level]
        groups = np.split(np.arange(places.size), np.flatnonzero(np.diff(places) > ORDER) + 1)
        if not places.size or len(groups) > max(8, MAX_SHARE * size.size):
            return ()
        found = (self._found(places[group], float(np.max(level[group]))) for group in groups)
        return tuple(itertools.chain.from_iterable(found))

    def _found(self, places: NDArray[np.int_], level: float) -> tuple[Event, ...]:
        """Return what happened around some samples next to each other; nothing beside samples that are not valid."""
        low = max(int(places[0]) - ORDER, ORDER)
        high = min(int(places[-1]) + ORDER + 1, self.valid.size - ORDER)
        if not self.valid[low - ORDER : high + ORDER].all():
            return ()
        usual = level * self.prediction.deviation
        peak = int(places[np.argmax(np.abs(self.errors[places]))])
        forward, backward = self.prediction.both(self.series[low - ORDER : high + ORDER])
        after = np.flatnonzero(np.abs(forward[:-ORDER]) > NOISE * usual)
        before = np.flatnonzero(np.abs(backward[ORDER:]) > NOISE * usual)
        first = low + int(after[0]) if after.size else peak
        end = low + int(before[-1]) + 1 if before.size else peak + 1
        if first == low or end == high:  # it began before, or goes on behind what can be judged
            return ()
        strength = float(np.abs(self.errors[peak])) / level
        around_peak = [(peak, peak + 1), (peak, peak + 2), (peak - 1, peak + 1)]
        candidates = [(first - left, end + right) for left, right in _WIDER if end > first]
        for begin, behind in candidates or around_peak:
            if begin < low or behind - begin > self.longest:
                break
            errors = forward[begin - low : behind - low + ORDER]
            lone, wild = self._explained(errors, usual, behind - begin)
            # a corner of the motion is seldom told from a wild sample that neither error shows
            if lone:
                return (Event(begin, behind, strength, lone, wild and end > first),)
        motion = Event(first, end, strength, lone=False, wild=False)
        for begin, behind in around_peak:
            if self._far_off(begin, behind):
                return Event(begin, behind, strength, lone=True, wild=True), *[motion] * (
                    not motion.torn
                )
        return (motion,)

    def _far_off(self, begin: int, behind: int) -> bool:
        """Tell whether samples stand out of a motion that is not predicted: of its changes from sample to sample."""
        before = np.arange(max(begin - ORDER, 0), begin)
        beside = np.append(before, np.arange(behind, min(behind + ORDER, self.series.size)))
        off = self.series[begin:behind] - np.interp(
            np.arange(begin, behind), beside, self.series[beside]
        )
        change = float(np.max(np.abs(np.diff(self.series[beside]))))
        return float(np.min(np.abs(off))) > max(STANDS_OUT * change, self.smallest)

    def _explained(self, errors: FloatArray, usual: float, length: int) -> tuple[bool, bool]:
        """Tell whether the first ``length`` samples explain some forward errors, if wild, and whether they surely are.

        ``usual``: standard deviation of the errors.
        """
        sizes, remainder = self._split(errors, length)
        gained = float(errors @ errors - remainder @ remainder) / usual**2
        lone = (
            float(np.max(np.abs(remainder))) <= NOISE * usual
            and float(np.max(np.abs(sizes))) > self.smallest
        )
        return lone, lone and gained > STANDS_OUT**2 + length

    def _split(self, errors: FloatArray, length: int) -> tuple[FloatArray, FloatArray]:
        """Return how far off the first ``length`` samples of some errors are, and the errors that this leaves."""
        taps = np.pad(self.prediction.taps, (length - 1, max(errors.size - ORDER - 1, 0)))
        design = sliding_window_view(taps[: errors.size + length - 1], errors.size)[::-1].T
        sizes = np.asarray(np.linalg.lstsq(design, errors, rcond=None)[0], dtype=np.float64)
        return sizes, errors - design @ sizes

    def sizes(self, event: Event) -> FloatArray:
        """Return how far wild samples are off what those before and after them predict."""
        errors = self.prediction.both(self.series[event.first - ORDER : event.end + ORDER])[0]
        return self._split(errors, event.end - event.first)[0]

    @functools.cached_property
    def wild(self) -> BoolArray:
        """Wild samples, shape (samples,)."""
        flags = np.zeros(self.series.shape, dtype=bool)
        if self.readable:
            runs = [event for event in self.events if event.wild]
            for run in runs if len(runs) <= max(4, MAX_SHARE * flags.size) else []:
                guard = GUARD * (run.end - run.first > MAX_SHORT_RUN)
                flags[max(run.first - guard, 0) : run.end + guard] = True
        return flags


@dataclass(frozen=True, eq=False)
class Prediction:
    """A prediction fitted to a channel.

    Attributes:
        taps: error of the sample after a wild one of size one, and of those after that; shape
            (ORDER + 1,).
        deviation: standard deviation of the errors where the prediction was fitted.
    """

    taps: FloatArray
    deviation: float

    def both(self, series: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the forward errors of all but the first ORDER samples, and the backward errors of all but the last."""
        return np.convolve(series, self.taps, mode="valid"), np.convolve(
            series, self.taps[::-1], mode="valid"
        )

    def matched(self, series: FloatArray, judged: BoolArray) -> FloatArray:
        """Return the forward errors matched to a single wild sample, of variance one, shape (samples,)."""
        scale = self.deviation * float(np.linalg.norm(self.taps))
        double = np.convolve(self.taps, self.taps[::-1]) / scale
        return np.where(judged, np.convolve(series, double, mode="same"), 0.0)


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples that a prediction is fitted to, with those before them, in blocks of a record.

    Attributes:
        windows: each sample behind ORDER others, shape (rows, ORDER + 1).
        clean: rows to use, shape (rows,).
    """

    windows: FloatArray
    clean: BoolArray

    @classmethod
    def from_series(cls, series: FloatArray, follows: BoolArray) -> Samples:
        """Return some samples of a series, evenly spread, those that ``follows`` says to be predictable."""
        every = sliding_window_view(series, ORDER + 1)
        begins = np.linspace(
            0, max(len(every) - BLOCK, 0), MAX_BLOCKS if len(every) > BLOCK * MAX_BLOCKS else 1
        )
        length = BLOCK if begins.size > 1 else len(every)
        rows = (begins.astype(int)[:, None] + np.arange(length)).ravel()
        return cls(every[rows], follows[rows + ORDER])

    def fit(self) -> Prediction:
        """Return the prediction of least squares, forwards and backwards."""
        windows = self.windows if self.clean.all() else self.windows[self.clean]
        products = windows.T @ windows
        products = products + products[::-1, ::-1]
        products += RIDGE * (np.trace(products) + len(windows)) * np.eye(ORDER + 1)
        taps = np.append(-np.linalg.solve(products[:-1, :-1], products[:-1, -1]), 1.0)[::-1]
        return Prediction(taps, max(float(np.std(windows @ taps[::-1])), np.finfo(float).eps))

    def without_worst(self, prediction: Prediction) -> Samples:
        """Return the same samples without those near what a prediction does not explain; all if these are most.

        Half of them may lie at rest, which tells nothing of the motion.
        """
        size = np.abs(self.windows @ prediction.taps[::-1])
        usual = float(np.median(size[self.clean])) / MEDIAN
        clean = self.clean & ~_near(self.clean & (size > NOISE * usual), ORDER)
        return Samples(self.windows, clean) if np.sum(clean) > 0.5 * np.sum(self.clean) else self


def moves(other: Channel, bad: BoolArray) -> BoolArray:
    """Return which samples are motion, shape (samples,): the other channel does something odd there, too.

    A jump of velocity is a pulse of acceleration of a few samples, so the other's differences are
    looked at as well. A sample or two are not explained by what the other shows before, throughout
    and after them.

    Args:
        other: the other channel.
        bad: samples that are odd in a channel, shape (samples,).
    """
    places = np.flatnonzero(bad)
    moved = np.zeros(bad.shape, dtype=bool)
    short = bad.copy()
    for first, end in zip(*runs_of_true(bad), strict=True):
        short[first:end] = end - first <= MAX_SHORT_RUN
    for order in range(3):  # motion of one channel is that of the other up to two derivatives
        if order:
            series = np.diff(other.series, prepend=other.series[:1])
            other = Channel.from_values(series, other.valid & np.roll(other.valid, 1))
        if places.size and other.readable:
            odd = np.zeros(bad.shape, dtype=bool)
            reach = TOGETHER + order
            near = np.flatnonzero(_near(bad, reach))
            odd[near] = np.abs(other.errors[near]) > NOISE * other.level(near)
            midst = np.zeros(bad.shape, dtype=bool)
            for event in other.events:
                midst[event.first + reach + 1 : max(event.end - reach - 1, 0)] = True
            moved |= bad & _near(odd, reach) & ~(short & midst)
    return moved


def breaks(reference: Channel, response: Channel) -> NDArray[np.int_]:
    """Return the samples at which both channels of a stationary motion jump: time was lost before them.

    There both go on elsewhere, which no wild samples explain, and nothing lies between what was
    before and what is after it: a knock lasts. A motion that begins or ends is not a break, nor is
    one of several close together: something was moving there.
    """
    places = []
    for event in reference.events:
        for other in (each for each in response.events if each.meets(event)):
            strongest = max(event, other, key=lambda each: each.strength)
            place = max(strongest.first, 0)
            seen = strongest.strength > STANDS_OUT and not (event.plain and other.plain)
            if seen and event.torn and other.torn:
                places += [place] * all(
                    _breaks_off(channel, place) for channel in (reference, response)
                )
    apart = np.diff(
        np.unique(np.array(places, dtype=int)),
        prepend=-BESIDE,
        append=reference.valid.size + BESIDE,
    )
    return np.unique(np.array(places, dtype=int))[(apart[:-1] >= BESIDE) & (apart[1:] >= BESIDE)]


def _breaks_off(channel: Channel, place: int) -> bool:
    """Tell whether a channel jumps at a sample, and its motion is about as large before it as after it."""
    series = channel.series
    errors = channel.prediction.both(series[max(place - 2 * ORDER, 0) : place + 2 * ORDER])[0]
    before = series[max(place - BESIDE - ORDER, 0) : place]
    after = series[place : place + ORDER + BESIDE]
    if min(before.size, after.size) < ORDER or float(np.max(np.abs(errors))) < MIN_BREAK * float(
        np.std(series)
    ):
        return False
    sizes = sorted((float(np.std(before)), float(np.std(after))))
    return sizes[0] > ALIKE * sizes[1]


def _near(flags: BoolArray, reach: int) -> BoolArray:
    """Return which samples have a flag within reach, shape (samples,)."""
    count = np.cumsum(np.pad(flags, (reach + 1, reach)))
    return count[2 * reach + 1 :] > count[: -2 * reach - 1]

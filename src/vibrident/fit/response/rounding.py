"""What a converter's steps do to a record.

Rounding to steps q moves a sample by up to q/2. While the signal runs over many steps this is white noise of variance
q²/12 and shows in the residual. In a record that is nearly still it is no noise: sample after sample is rounded the
same way, slow tails are lost, and the residual looks quieter than the data are (Widrow & Kollár 2008). So no residual
of a rounded channel is taken to be below q²/12.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from weakref import ref

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import distinct

#: Noise of so many steps turns rounding errors into white noise.
DITHERED = 0.6
#: Number of sizes of a motion within one step, at which its rounding errors are looked at.
TRIALS = 6
#: Samples looked at.
SOME = 20_000
#: Values closer than this part of the range are equal.
SAME = 1e-12
#: All values lie on the grid to this part of a step.
ON_GRID = 0.05
#: Fewest different values; fewer may lie on a grid by chance.
FEWEST = 3
#: Values that are compared with a grid.
MOST_ON_GRID = 1000
#: So many tell mostly that there is no grid.
FIRST = 32
#: A step is told by values so many times farther apart than those that told it before.
FARTHER = 4.0
#: Largest number of steps in the smallest difference of two values.
STEPS_APART = 4
#: A motion in step with the sampling shows so few values …
FEW = 64
#: … that many steps may lie between any two: at most so many, on a grid to this part of a step.
MOST_APART, ON_FINE_GRID = 4000, 1e-3
#: The values of a motion in step with the sampling return at least so often.
REPEATS = 8
#: Samples of the longest period in which it returns.
LONGEST_PERIOD = 4096
#: A sine is in step if it moves no sample by this part of a step over the record.
DRIFTED = 0.5


def converter_step(values: FloatArray, valid: BoolArray | None = None) -> float:
    """The converter's step, where values lie on a grid; else zero.

    Args:
        values: one channel, shape (samples,).
        valid: samples to look at, shape (samples,); None: all.
    """
    every = slice(None, None, max(1, values.size // SOME))
    if valid is not None and not valid.all():
        return _step_of(values[every][valid[every]])
    if values.base is not None or values.flags.writeable:
        return _step_of(values[every])
    known = _STEPS.get(id(values))
    if known is None or known[0]() is not values:
        forget = functools.partial(_forget, id(values))
        known = _STEPS[id(values)] = ref(values, forget), _step_of(values[every])
    return known[1]


#: Steps of channels of records, which cannot change: several findings need them.
_STEPS: dict[int, tuple[ref[FloatArray], float]] = {}


def _forget(key: int, _: object) -> None:
    _STEPS.pop(key, None)


def _step_of(seen: FloatArray) -> float:
    ordered = np.sort(seen)
    gaps = np.diff(ordered)
    apart = gaps > SAME * (ordered[-1] - ordered[0]) if gaps.size else gaps > 0.0
    if np.count_nonzero(apart) >= FEW:
        return grid_step(ordered, STEPS_APART)
    if np.count_nonzero(apart) < FEWEST - 1:
        return 0.0
    return _step_between_few(ordered[np.concatenate([[True], apart])], float(np.min(gaps[apart])))


def smallest_step(values: FloatArray) -> float:
    """Smallest difference of values that occur; zero where all are the same."""
    ordered = np.sort(values)
    steps = np.diff(ordered)
    steps = steps[steps > SAME * (ordered[-1] - ordered[0])]
    return float(np.min(steps)) if steps.size else 0.0


def grid_step(values: FloatArray, most_apart: int) -> float:
    """Step of the grid on which values lie; zero where there is none.

    Args:
        values: as they rise, shape (samples,).
        most_apart: steps that there may be in the smallest difference of two of them.
    """
    gaps = np.diff(values)
    apart = gaps > SAME * (values[-1] - values[0])
    if not np.any(apart):
        return 0.0
    least = float(np.min(gaps[apart]))
    above = values[:: max(1, values.size // MOST_ON_GRID)] - values[0]
    parts = kept = np.arange(1.0, most_apart + 1.0)[:, None]
    for some in (above[:: max(1, above.size // FIRST)] / least, above / least):
        kept = kept[np.max(np.abs(kept * some - np.rint(kept * some)), axis=1, initial=0.0) < ON_GRID]
    if kept.size:
        return least / float(kept[0, 0])
    if np.all(apart):
        return 0.0  # values that occur once each: the steps are too fine to tell
    return _step_of_rounded(above, float(np.mean(gaps[(gaps > 0.5 * least) & (gaps < 1.5 * least)])) / parts)


def _step_of_rounded(above: FloatArray, found: FloatArray) -> float:
    """Step of a grid whose values were rounded, as numbers of single precision are; zero where there is none.

    The step is told the better the farther apart the values are by which it is told.

    Args:
        above: distances from the lowest value, as they rise.
        found: steps that are possible by neighbours alone, shape (steps, 1).
    """
    reach = FARTHER * float(np.max(found))
    while found.size and reach < FARTHER * above[-1]:
        near = above[above <= reach]
        counts = np.rint(near / found)
        squares = np.sum(counts**2, axis=1, keepdims=True)
        found = np.where(squares > 0.0, np.sum(near * counts, axis=1, keepdims=True) / np.maximum(squares, 1.0), found)
        found = found[np.max(np.abs(near - counts * found), axis=1) < ON_GRID * found[:, 0]]
        reach *= FARTHER
    return float(np.max(found, initial=0.0))


def _step_between_few(values: FloatArray, least: float) -> float:
    """The step of a grid through a few values that rise, ``least`` apart or more; zero where there is none."""
    if values.size < FEWEST:
        return 0.0
    place = np.arange(1.0, MOST_APART + 1.0)[:, None] * ((values - values[0]) / least)
    off = np.max(np.abs(place - np.rint(place)), axis=1)
    parts = 1 + np.flatnonzero((off < ON_FINE_GRID) | ((off < ON_GRID) & (np.arange(MOST_APART) < STEPS_APART)))
    return least / float(parts[0]) if parts.size else 0.0


def repeated_errors(values: FloatArray, used: BoolArray, turns: float) -> tuple[int, float]:
    """Number of different rounding errors of a sine in step with the sampling, and the step; zeros for others.

    A few samples a period, always at the same phases, are rounded in the same way from period to period: as many
    errors are left as there are distances from the mean, and no longer record has a smaller one.

    Args:
        values: a channel, shape (samples,).
        used: samples that count, shape (samples,).
        turns: of the sine from sample to sample.
    """
    period = np.arange(1, min(LONGEST_PERIOD, max(values.size // REPEATS, 1)) + 1)
    drift = np.abs(period * turns - np.rint(period * turns)) * values.size / period
    if np.min(drift) > 1.0 or np.count_nonzero(used) < REPEATS * FEWEST:
        return 0, 0.0
    seen = values[used]
    span = float(np.ptp(seen))
    if span == 0.0:
        return 0, 0.0
    step = converter_step(values, used)
    period = period[np.pi * span * drift < DRIFTED * step]
    if step == 0.0 or not period.size:
        return 0, 0.0
    whole = int(period[0])
    number = whole if whole % 2 else max(whole // 2, 1)  # the halves of a period are rounded alike
    if whole > FEW:
        return number, step
    levels = distinct(np.rint(np.abs(seen - np.mean(seen)) / (0.5 * step)))
    return min(1 + int(np.sum(np.diff(levels) > 1.5)), number), step  # noise may reach the neighbouring code


def undithered(step: float, residual_variance: float) -> float:
    """Part of the variance of rounding errors that noise leaves coherent with the motion (Widrow & Kollár 2008).

    Args:
        step: of the converter.
        residual_variance: noise and rounding errors together.
    """
    noise = max(residual_variance - step**2 / 12.0, 0.0)
    return float(np.exp(-((2.0 * np.pi) ** 2) * noise / step**2))


def returning_error(values: FloatArray, used: BoolArray, turns: float, residual: FloatArray) -> float:
    """Variance of the real part of a sine's amplitude by rounding errors that return each period.

    Args:
        values: a channel, as it was measured, shape (samples,).
        used: samples that count, shape (samples,).
        turns: of the sine from sample to sample.
        residual: of the channel where it counts; noise makes the errors of the steps noise.
    """
    number, step = repeated_errors(values, used, turns)
    return step**2 / (6.0 * number) * undithered(step, float(residual.var())) if number else 0.0


def rounding_variance(record: Record, gain_squares: Callable[[], FloatArray]) -> FloatArray | None:
    """Variance a sample that rounding makes in measured less predicted response; None if the channel has no steps.

    Args:
        record: with a reference or without.
        gain_squares: returns |H|² of the model at the spectral lines, shape (lines,).

    Returns:
        Shape (lines,), squares of the response unit.
    """
    own = converter_step(record.response, record.mask)
    other = 0.0 if record.reference is None else converter_step(record.reference, record.reference_mask)
    return None if own == other == 0.0 else (own**2 + other**2 * gain_squares()) / 12.0


def rounding_errors(values: FloatArray, used: BoolArray, step: float, origin: float) -> FloatArray:
    """Rounded less true values, at TRIALS sizes of the motion within one step of its peak, shape (TRIALS, samples).

    Args:
        values: a channel without its rounding, shape (samples,).
        used: samples that count; the others, and the mean, are zero, shape (samples,).
        step: of the converter.
        origin: a value that the converter gives.
    """
    mean = float(np.mean(values[used]))
    motion = np.where(used, values - mean, 0.0)
    peak = max(float(np.max(np.abs(motion))), step)
    factor = 1.0 + ((np.arange(TRIALS) + 0.5) / TRIALS - 0.5) * step / peak
    sized = factor[:, None] * motion + (mean - origin)
    errors = step * np.rint(sized / step) - sized
    return np.where(used, errors - np.mean(errors[:, used], axis=1, keepdims=True), 0.0)

"""The steps of a converter: the grid on which the values of a channel lie."""

from __future__ import annotations

import functools
from weakref import ref

import numpy as np

from vibrident.data.records import BoolArray, FloatArray

#: Samples that are sorted; of a longer channel every n-th.
MAX_SAMPLES = 20_000
#: Values closer than this share of the range are equal.
RELATIVE_EQUALITY = 1e-12
#: Values lie on a grid if they are off it by less than this share of a step.
MAX_OFF_GRID = 0.05
#: Fewest different values that show a grid; fewer may lie on one by chance.
MIN_VALUES = 3
#: Largest number of values that are compared with a grid.
MAX_COMPARED_VALUES = 1000
#: Values that are compared first: mostly they suffice to exclude a grid.
PRESCREENED_VALUES = 32
#: Each refinement of a step takes in values this many times farther apart.
REACH_RATIO = 4.0
#: Largest number of steps in the smallest difference of two values.
MAX_STEPS_APART = 4
#: With fewer different values than this, as a motion in step with the sampling shows, …
MIN_MANY_VALUES = 64
#: … many steps may lie between any two: at most this many, and the grid is met more closely.
MAX_FINE_STEPS_APART = 4000
MAX_OFF_FINE_GRID = 1e-3


def converter_step(values: FloatArray, valid: BoolArray | None = None) -> float:
    """Return the converter's step, where values lie on a grid; else zero.

    Args:
        values: one channel, shape (samples,).
        valid: samples to look at, shape (samples,); None: all.
    """
    every = slice(None, None, max(1, values.size // MAX_SAMPLES))
    if valid is not None and not valid.all():
        return _step_of(values[every][valid[every]])
    if values.base is not None or values.flags.writeable:
        return _step_of(values[every])
    cached = _STEPS.get(id(values))
    if cached is None or cached[0]() is not values:
        forget = functools.partial(_drop_step, id(values))
        cached = _STEPS[id(values)] = ref(values, forget), _step_of(values[every])
    return cached[1]


#: Steps of channels of records, which cannot change: several findings need them.
_STEPS: dict[int, tuple[ref[FloatArray], float]] = {}


def _drop_step(key: int, _: object) -> None:
    _STEPS.pop(key, None)


def _step_of(values: FloatArray) -> float:
    ordered = np.sort(values)
    gaps = np.diff(ordered)
    apart = gaps > RELATIVE_EQUALITY * (ordered[-1] - ordered[0]) if gaps.size else gaps > 0.0
    if np.count_nonzero(apart) >= MIN_MANY_VALUES:
        return grid_step(ordered, MAX_STEPS_APART)
    if np.count_nonzero(apart) < MIN_VALUES - 1:
        return 0.0
    return _step_of_few(ordered[np.concatenate([[True], apart])], float(np.min(gaps[apart])))


def smallest_step(values: FloatArray) -> float:
    """Return the smallest difference of values that occur; zero where all are the same."""
    ordered = np.sort(values)
    steps = np.diff(ordered)
    steps = steps[steps > RELATIVE_EQUALITY * (ordered[-1] - ordered[0])]
    return float(np.min(steps)) if steps.size else 0.0


def grid_step(values: FloatArray, most_apart: int) -> float:
    """Return the step of the grid on which values lie; zero where there is none.

    Args:
        values: in rising order, shape (samples,).
        most_apart: largest number of steps in the smallest difference of two values.
    """
    gaps = values[1:] - values[:-1]
    apart = gaps > RELATIVE_EQUALITY * (values[-1] - values[0])
    occurring = gaps if np.all(apart) else gaps[apart]
    if not occurring.size:
        return 0.0
    least = float(np.min(occurring))
    above = values[:: max(1, values.size // MAX_COMPARED_VALUES)] - values[0]
    multiples = candidates = np.arange(1.0, most_apart + 1.0)[:, None]
    for distances in (above[:: max(1, above.size // PRESCREENED_VALUES)] / least, above / least):
        candidates = candidates[
            np.max(
                np.abs(candidates * distances - np.rint(candidates * distances)),
                axis=1,
                initial=0.0,
            )
            < MAX_OFF_GRID
        ]
    if candidates.size:
        return least / float(candidates[0, 0])
    if occurring is gaps:
        return 0.0  # values that occur once each: the steps are too fine to tell
    return _step_of_rounded(
        above, float(np.mean(gaps[(gaps > 0.5 * least) & (gaps < 1.5 * least)])) / multiples
    )


def _step_of_rounded(above: FloatArray, steps: FloatArray) -> float:
    """Return the step of a grid whose values were rounded, as in single precision.

    The farther apart the values are, the better they determine the step.

    Args:
        above: distances from the lowest value, in rising order.
        steps: steps that are possible by neighbours alone, shape (steps, 1).

    Returns:
        the largest possible step; zero where there is none.
    """
    reach = REACH_RATIO * float(np.max(steps))
    while steps.size and reach < REACH_RATIO * above[-1]:
        near = above[above <= reach]
        counts = np.rint(near / steps)
        squares = np.sum(counts**2, axis=1, keepdims=True)
        steps = np.where(
            squares > 0.0,
            np.sum(near * counts, axis=1, keepdims=True) / np.maximum(squares, 1.0),
            steps,
        )
        steps = steps[np.max(np.abs(near - counts * steps), axis=1) < MAX_OFF_GRID * steps[:, 0]]
        reach *= REACH_RATIO
    return float(np.max(steps, initial=0.0))


def _step_of_few(values: FloatArray, least: float) -> float:
    """Return the step of a grid through a few values in rising order; zero where there is none.

    ``least``: their smallest difference.
    """
    if values.size < MIN_VALUES:
        return 0.0
    multiples = np.arange(1.0, MAX_FINE_STEPS_APART + 1.0)[:, None] * ((values - values[0]) / least)
    distance = np.max(np.abs(multiples - np.rint(multiples)), axis=1)
    factors = 1 + np.flatnonzero(
        (distance < MAX_OFF_FINE_GRID)
        | ((distance < MAX_OFF_GRID) & (np.arange(MAX_FINE_STEPS_APART) < MAX_STEPS_APART))
    )
    return least / float(factors[0]) if factors.size else 0.0

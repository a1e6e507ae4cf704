"""The steps of a converter: the grid on which the values of a channel lie."""

from __future__ import annotations

import functools
from weakref import ref

import numpy as np

from vibrident.data.records import BoolArray, FloatArray

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
MOST_APART = 4000
ON_FINE_GRID = 1e-3


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
    least = float(np.min(gaps, where=apart, initial=np.inf))
    above = values[:: max(1, values.size // MOST_ON_GRID)] - values[0]
    parts = kept = np.arange(1.0, most_apart + 1.0)[:, None]
    for some in (above[:: max(1, above.size // FIRST)] / least, above / least):
        kept = kept[
            np.max(np.abs(kept * some - np.rint(kept * some)), axis=1, initial=0.0) < ON_GRID
        ]
    if kept.size:
        return least / float(kept[0, 0])
    if np.all(apart):
        return 0.0  # values that occur once each: the steps are too fine to tell
    return _step_of_rounded(
        above, float(np.mean(gaps[(gaps > 0.5 * least) & (gaps < 1.5 * least)])) / parts
    )


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
        found = np.where(
            squares > 0.0,
            np.sum(near * counts, axis=1, keepdims=True) / np.maximum(squares, 1.0),
            found,
        )
        found = found[np.max(np.abs(near - counts * found), axis=1) < ON_GRID * found[:, 0]]
        reach *= FARTHER
    return float(np.max(found, initial=0.0))


def _step_between_few(values: FloatArray, least: float) -> float:
    """The step of a grid through a few values that rise, ``least`` apart or more; zero where there is none."""
    if values.size < FEWEST:
        return 0.0
    place = np.arange(1.0, MOST_APART + 1.0)[:, None] * ((values - values[0]) / least)
    off = np.max(np.abs(place - np.rint(place)), axis=1)
    parts = 1 + np.flatnonzero(
        (off < ON_FINE_GRID) | ((off < ON_GRID) & (np.arange(MOST_APART) < STEPS_APART))
    )
    return least / float(parts[0]) if parts.size else 0.0

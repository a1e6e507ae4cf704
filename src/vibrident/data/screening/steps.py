"""The steps of a converter: the grid on which the values of a channel lie."""

from __future__ import annotations

import functools
import math
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
#: With fewer different values than this, no two may be neighbours on the grid.
MIN_MANY_VALUES = 64
#: A motion in step with the sampling shows at most this many different values, …
MAX_FEW_VALUES = 1000
#: … or this share of the samples. Then a grid is met more closely, …
MAX_DISTINCT_SHARE = 0.5
MAX_OFF_FINE_GRID = 1e-3
#: … its range has at most this many steps, as finer converters show noise alone, …
MAX_STEPS_OF_CONVERTER = 2.0**26
#: … and numbers without a grid have one by chance with this probability.
MAX_GRID_CHANCE = 1e-4


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
    count = int(np.count_nonzero(apart))
    step = grid_step(ordered, MAX_STEPS_APART) if count >= MIN_MANY_VALUES else 0.0
    if step > 0.0 or count > min(MAX_FEW_VALUES, MAX_DISTINCT_SHARE * values.size):
        return step
    if count < MIN_VALUES - 1:
        return 0.0
    return _step_of_few(ordered[np.concatenate([[True], apart])])


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


def _step_of_few(values: FloatArray) -> float:
    """Return the step of a grid through a few values in rising order; zero where there is none.

    The values may have been stored in double or in single precision.
    """
    for precision in (np.float64, np.float32):
        step = _common_step(values, float(np.finfo(precision).eps))
        if step:
            return step
    return 0.0


def _common_step(values: FloatArray, rounding: float) -> float:
    """Return the largest step of which all differences of values are multiples; zero if none.

    The lowest value and the highest are N steps apart, where N is the least common multiple of the
    denominators of all differences over the range.

    Args:
        values: in rising order, shape (n,), n ≥ 3.
        rounding: of a value, relative.
    """
    above = values[1:] - values[0]
    share = above / above[-1]
    tolerance = 4.0 * rounding * float(np.max(np.abs(values[[0, -1]]))) / float(above[-1])
    # N by chance: each of the shares is within the tolerance of a multiple of 1/N, for some N.
    inner = len(share) - 1
    by_chance = (math.log(MAX_GRID_CHANCE) - inner * math.log(2.0 * tolerance)) / (inner + 1)
    most = min(MAX_STEPS_OF_CONVERTER, MAX_OFF_FINE_GRID / tolerance, math.exp(by_chance))
    steps = 1
    for ratio in share.tolist():
        if abs(math.remainder(ratio * steps, 1.0)) > MAX_OFF_FINE_GRID:
            steps = math.lcm(steps, _denominator(ratio, tolerance))
        if steps > most:
            return 0.0
    multiples = share * steps
    is_grid = np.max(np.abs(multiples - np.rint(multiples))) < MAX_OFF_FINE_GRID
    return float(above[-1]) / steps if is_grid else 0.0


def _denominator(number: float, tolerance: float) -> int:
    """Return the denominator of the first convergent of a continued fraction near a number."""
    dividend, divisor = number.as_integer_ratio()
    numerators = (0, 1)
    denominators = (1, 0)
    while divisor:
        quotient, remainder = divmod(dividend, divisor)
        dividend = divisor
        divisor = remainder
        numerators = (numerators[1], quotient * numerators[1] + numerators[0])
        denominators = (denominators[1], quotient * denominators[1] + denominators[0])
        if abs(numerators[1] / denominators[1] - number) <= tolerance:
            break
    return denominators[1]

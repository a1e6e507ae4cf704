"""Samples that a channel could not follow: piled up at a rail.

The values of a free signal thin out towards its extreme, or crowd there as its turns make them: a
turn of order n (a parabola has n = 2) spends t ∝ d^{1/n} within d of its top, so of bins of equal
width counted from the top the first holds at most 1/(2^{1/n} − 1) times the second, and the second
more than those below it. At a rail the first bin is far fuller than the second, and the second no
fuller than those below. That holds for any motion, whether the samples at the rail are exactly
equal (bins: the values that occur) or carry noise (bins of some width), and needs no full scale.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import runs_of_true
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.steps import RELATIVE_EQUALITY, grid_step, smallest_step

#: The first bin holds at least this many times the second …
MIN_FIRST_TO_SECOND = 4.0
#: … and the second at most this many times the mean of the four below it (a parabola's: 1.6 times,
#: a flatter top's more).
MAX_SECOND_TO_LOWER = 1.4
#: … and by chance no more than this many standard deviations of its count above that, unless …
COUNT_DEVIATIONS = 3.0
#: … it holds this many times the fewest samples of a rail.
CERTAIN_COUNT_RATIO = 30.0
#: Fewest samples in the first bin where they are exactly equal.
MIN_EQUAL_SAMPLES = 8
#: Fewest samples in the first bin where they carry noise.
MIN_NOISY_SAMPLES = 40
#: Where the values below the first occur once each: chance below which equal ones are a rail.
CHANCE_OF_TIES = 1e-5
#: Values below the first that are compared with it.
VALUES_BELOW = 8
#: Bins below the first that are compared with it.
BINS_BELOW = 5
#: Widths of bins: the range over these powers of two.
WIDTH_POWERS = range(4, 13)
#: A rail is visited at least this often …
MIN_VISITS = 3
#: … unless its samples are exactly equal for at least this many samples.
LONG_VISIT_SAMPLES = 8
#: A level is synchronous sampling, not a rail, if more than this share of its visits is evenly
#: spaced.
EVENLY_SPACED_SHARE = 0.9
#: A level is rest if it holds this share of the record in one piece …
REST_SHARE_IN_ONE_PIECE = 0.12
#: … or this share of it in all.
REST_SHARE_IN_ALL = 0.45
#: A signal whose two levels together hold more than this share is a square wave.
SQUARE_WAVE_SHARE = 0.9
#: Visits no longer than this are doubted in a signal that neighbouring samples predict well.
MAX_SHORT_VISIT_SAMPLES = 6.0
#: Neighbours on either side that predict a sample.
NEIGHBOURS = 3
#: A prediction is good up to this error, relative to the signal's standard deviation.
MAX_PREDICTION_ERROR = 0.1
#: Prediction errors at a rail exceed the others by at least this factor.
MIN_ERROR_RATIO = 1.6
#: The samples beside a visit to a rail lead past it by at least this share of the range: less is
#: the flat step of a coarse generator.
MIN_OVERSHOOT = 2.5e-3
#: Longest visits that are examined for this.
MAX_EXAMINED_VISITS = 15
#: Steps of a converter are above this part of its full scale: 30 bits.
MIN_STEP_OF_FULL_SCALE = 2.0**-30
#: The smallest difference between values that occur is at most this many steps.
MAX_STEPS_IN_DIFFERENCE = 24
#: The same of a few samples at the top, which lie far apart where a converter is fine.
MAX_STEPS_AT_TOP = 1000


def clipped(
    channel: ChannelSamples, full_scale: float | None = None
) -> tuple[BoolArray, list[float]]:
    """Return the clipped samples with a guard on either side, and the levels of the rails.

    Args:
        channel: the samples to look at.
        full_scale: largest magnitude that the channel can hold; it then decides alone. None: the
            values decide.

    Returns:
        flags, shape (samples,), and levels in the unit of the values.
    """
    values = channel.values
    valid = channel.valid
    if channel.ordered.size < 8:
        return np.zeros(values.shape, dtype=bool), []
    if full_scale is not None:
        flags = valid & _at_full_scale(values, full_scale, smallest_step(values[valid]))
        return _with_guard(flags), sorted({float(np.sign(v)) * full_scale for v in values[flags]})
    ordered = channel.ordered
    step = functools.cache(lambda: grid_step(ordered, MAX_STEPS_IN_DIFFERENCE))
    tops = (1.0, ordered[::-1]), (-1.0, -ordered)
    rails = [
        (side, rail)
        for side, top in tops
        if (rail := _rail(side * values, valid, top, step)) is not None
    ]
    flags = np.zeros(values.shape, dtype=bool)
    for side, rail in rails:
        flags |= valid & (side * values >= rail)
    if rails and np.sum(flags) > SQUARE_WAVE_SHARE * np.sum(valid):
        return np.zeros(values.shape, dtype=bool), []
    levels = [float(np.median(values[valid & (side * values >= rail)])) for side, rail in rails]
    return _with_guard(flags), levels


def _at_full_scale(values: FloatArray, full_scale: float, step: float) -> BoolArray:
    """Return which values are at ± full scale.

    The highest code of a converter in two's complement lies one step below full scale.
    """
    is_stepped = step > MIN_STEP_OF_FULL_SCALE * full_scale
    coarse = is_stepped and abs(full_scale / step - np.rint(full_scale / step)) < 1e-6
    top = full_scale - step * 1.001 if coarse else full_scale * (1.0 - 1e-9)
    return (values >= top) | (values <= -full_scale * (1.0 - 1e-9))


def _rail(
    values: FloatArray, valid: BoolArray, top: FloatArray, step_of_grid: Callable[[], float]
) -> float | None:
    """Return the lowest value that counts as at the upper rail; None if there is no rail.

    Args:
        values: the channel, upside down for its lower rail, shape (samples,).
        valid: samples to look at, shape (samples,).
        top: the valid values in falling order.
        step_of_grid: the step of the grid on which they lie, zero without one; seldom needed.
    """
    span = float(top[0] - top[-1])
    if span == 0.0:
        return None
    equal_values_rail = _rail_of_equal_values(values, valid, top, RELATIVE_EQUALITY * span)
    if equal_values_rail is not None:
        return equal_values_rail
    below = -top
    step = step_of_grid()
    width = span * 0.5 ** np.array(WIDTH_POWERS)
    if step > 0.0:
        width = step * np.ceil(width / step)  # whole steps
    limits = float(top[0]) - width + 0.5 * step
    ends = np.searchsorted(
        below, np.multiply.outer(width, np.arange(BINS_BELOW + 1)) - limits[:, None]
    )
    counts = np.diff(ends, axis=1, prepend=0).astype(float)
    for index in np.flatnonzero(_is_piled_up(counts, MIN_NOISY_SAMPLES)).tolist():
        limit = float(limits[index])
        wide = float(width[index])
        if counts[index, 0] <= MIN_FIRST_TO_SECOND * _fullest_bin_below(
            top, limit, wide
        ) or _is_staircase(top, wide):
            continue
        inside = valid & (values > limit)
        if (
            _run_lengths(inside).size < MIN_VISITS
            or _is_synchronous(inside)
            or _is_rest_level(inside, valid)
        ):
            continue
        if _confirmed(values, inside, valid):
            return limit
    return None


def _fullest_bin_below(top: FloatArray, limit: float, width: float) -> float:
    """Return the count of the fullest bin between the first and the middle of the range.

    A generator's staircase fills such bins, too.
    """
    below = top[(top <= limit) & (top > 0.5 * (top[0] + top[-1]))]
    return float(np.max(np.bincount(((limit - below) / width).astype(int)), initial=0))


def _is_staircase(top: FloatArray, width: float) -> bool:
    """Return whether samples crowd at levels between the ends, except the level of rest.

    True for a signal with few levels in all, of which nothing else is known.
    """
    counts = np.bincount(((top[0] - top) / width + 0.5).astype(int)).astype(float)
    if counts.size < 2 * BINS_BELOW:
        return True
    near = np.maximum(counts[:-4], counts[4:])
    levels = 2 + np.flatnonzero(
        counts[2:-2] > np.maximum(MIN_FIRST_TO_SECOND * near, MIN_NOISY_SAMPLES)
    )
    rest_level = int(np.argmax(counts[2:-2])) + 2
    return bool(np.any(np.abs(levels - rest_level) > 2))


def _rail_of_equal_values(
    values: FloatArray, valid: BoolArray, top: FloatArray, same: float
) -> float | None:
    """Return the upper rail where its samples are exactly equal; None if there is no rail."""
    # The index of each value's first sample in the sorted list, from the top.
    begins = np.concatenate([[0], 1 + np.flatnonzero(top[:-1] - top[1:] > same)])[
        : VALUES_BELOW + 2
    ]
    counts = np.diff(
        begins if begins.size == VALUES_BELOW + 2 else np.append(begins, top.size)
    ).astype(float)
    if counts.size <= VALUES_BELOW:
        return None  # with a few levels the motion between them is not known
    most = float(np.max(counts[1:]))
    limit = float(top[0]) - same
    if counts[0] == most == 1.0:
        return None
    inside = valid & (values >= limit)
    if _is_synchronous(inside):
        return None
    if most == 1.0:
        strange = _ties_by_chance(top, counts[0]) < CHANCE_OF_TIES
        return limit if strange and not _is_rest_level(inside, valid) else None
    gaps = -np.diff(top[begins[: counts.size]])
    if gaps[0] > 1.5 * np.min(gaps) and counts[0] < 2.0 * MIN_FIRST_TO_SECOND * most:
        return None  # synchronous samples, which leave values out
    if counts[0] <= MIN_FIRST_TO_SECOND * most or not bool(_is_piled_up(counts, MIN_EQUAL_SAMPLES)):
        return None
    if (
        _run_lengths(inside).size < MIN_VISITS and np.max(_run_lengths(inside)) < LONG_VISIT_SAMPLES
    ) or _is_rest_level(inside, valid):
        return None
    return limit if _confirmed(values, inside, valid) else None


def _ties_by_chance(top: FloatArray, count: float) -> float:
    """Return the chance that ``count`` values are equal at the top.

    It follows from the distance of the values below them and the step of the values there: numbers
    of few digits have finer steps farther down.
    """
    below = int(count) + VALUES_BELOW - 1
    if below >= top.size:
        return 1.0
    distance = float(top[0] - top[below])
    return min(1.0, VALUES_BELOW * grid_step(-top[: below + 32], MAX_STEPS_AT_TOP) / distance) ** (
        count - 1.0
    )


def _is_piled_up(counts: FloatArray, fewest: int) -> BoolArray:
    """Return whether the first of the bins from the top, along the last axis, is a rail's."""
    first = counts[..., 0]
    second = counts[..., 1]
    below = np.mean(counts[..., 2:6], axis=-1)
    is_doubtful = first < CERTAIN_COUNT_RATIO * fewest
    doubt = np.where(is_doubtful, COUNT_DEVIATIONS * np.sqrt(np.maximum(second, 1.0)), 0.0)
    return (
        (first >= fewest)
        & (first > MIN_FIRST_TO_SECOND * second + doubt)
        & (second <= MAX_SECOND_TO_LOWER * below + 2.0)
    )


def _run_lengths(flags: BoolArray) -> FloatArray:
    begins, ends = runs_of_true(flags)
    return (ends - begins).astype(float)


def _is_synchronous(inside: BoolArray) -> bool:
    """Return whether one or two samples reach the level in each period, in step with the sampling.

    These tops of a tone return exactly once the motion has settled, while the values below them,
    from its beginning, occur once.
    """
    begins, ends = runs_of_true(inside)
    apart = np.diff(begins)
    if apart.size < MIN_VISITS - 1 or np.median(ends - begins) > 2:
        return False
    return float(np.mean(apart == np.median(apart))) > EVENLY_SPACED_SHARE


def _is_rest_level(inside: BoolArray, valid: BoolArray) -> bool:
    """Return whether the signal rests at the level, be it before or after a one-sided motion."""
    share = float(np.sum(inside)) / float(np.sum(valid))
    if share > REST_SHARE_IN_ALL or (_run_lengths(inside).size == 1 and (inside[0] or inside[-1])):
        return True
    # Noise may leave the level for a few samples.
    width = 9
    dense = np.convolve(inside, np.ones(width), mode="same") > 0.6 * width
    runs = _run_lengths(dense)
    longest = float(np.max(runs, initial=0.0))
    usual = float(np.median(runs)) if runs.size else 0.0
    begins = bool(dense[width] or dense[-width - 1])
    return longest > REST_SHARE_IN_ONE_PIECE * inside.size and (
        begins or runs.size < 4 or longest > 2.0 * usual
    )


def _confirmed(values: FloatArray, inside: BoolArray, valid: BoolArray) -> bool:
    """Return whether the motion beside the visits confirms a rail.

    Long visits: the samples beside them lead past the level. Short visits: neighbours predict them
    worse than the rest of the signal. A generator's stairs, and few samples a period in step with
    it, leave most values out, which breaks the law of the bins; but such a signal turns where its
    neighbours predict.
    """
    if np.median(_run_lengths(inside)) > MAX_SHORT_VISIT_SAMPLES:
        return _leads_past(values, inside)
    n = values.size
    reach = NEIGHBOURS
    middle = slice(reach, n - reach)
    used = valid[middle].copy()
    columns = [np.ones(n - 2 * reach)]
    for k in range(1, reach + 1):
        columns.append(values[reach - k : n - reach - k] + values[reach + k : n - reach + k])
        used &= valid[reach - k : n - reach - k] & valid[reach + k : n - reach + k]
    matrix = np.stack(columns, axis=1)
    if used.sum() < 4 * reach:
        return True
    amounts, *_ = np.linalg.lstsq(matrix[used], values[middle][used], rcond=1e-12)
    error = np.where(used, values[middle] - matrix @ amounts, 0.0)
    near = _with_guard(inside)[middle] & used
    apart = used & ~near
    if near.sum() < 3 or apart.sum() < 3:
        return True
    far = float(np.sqrt(np.mean(error[apart] ** 2)))
    if far > MAX_PREDICTION_ERROR * float(np.std(values[valid])):
        return True
    return float(np.sqrt(np.mean(error[near] ** 2))) > MIN_ERROR_RATIO * max(
        far, smallest_step(values[valid])
    )


def _leads_past(values: FloatArray, inside: BoolArray) -> bool:
    """Return whether parabolas through the samples beside the longest visits pass the level.

    True if more than half of them do.
    """
    begins, ends = runs_of_true(inside)
    visits = sorted(
        zip(begins.tolist(), ends.tolist(), strict=True), key=lambda run: run[0] - run[1]
    )
    past = []
    span = float(np.ptp(values))
    for first, end in visits[:MAX_EXAMINED_VISITS]:
        length = end - first
        stretch = max(3, (end - first) // 2)
        if first < stretch or end + stretch > values.size:
            continue
        times = np.concatenate([np.arange(-stretch, 0), length + np.arange(stretch)]) / length - 0.5
        sides = np.concatenate([values[first - stretch : first], values[end : end + stretch]])
        basis = np.stack([np.ones_like(times), times, times**2], axis=1)
        amounts, *_ = np.linalg.lstsq(basis, sides, rcond=None)
        misfit = float(np.sqrt(np.mean((sides - basis @ amounts) ** 2)))
        # A free signal does not jump to the level from far below it either.
        beyond = abs(float(amounts[0] - np.median(values[first:end])))
        past.append(beyond > max(float(np.ptp(values[first:end])), misfit, MIN_OVERSHOOT * span))
    return not past or sum(past) > 0.5 * len(past)


def _with_guard(flags: BoolArray) -> BoolArray:
    """Return the flags with one more sample on either side of each run."""
    wide = flags.copy()
    wide[1:] |= flags[:-1]
    wide[:-1] |= flags[1:]
    return wide

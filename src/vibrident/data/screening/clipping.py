"""Samples that a channel could not follow: piled up at a rail.

The values of a free signal thin out towards its extreme, or crowd there as its turns make them: a
turn of order n (a parabola has n = 2) spends t ∝ d^{1/n} within d of its top, so of bins of equal
width counted from the top the first holds at most 1/(2^{1/n} − 1) times the second, and the second
more than those below it. At a rail the first bin is far fuller than the second, and the second no
fuller than those below. That holds for any motion, whether the samples at the rail are exactly
equal (bins: the values that occur) or carry noise (bins of some width), and needs no full scale.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import runs_of_true
from vibrident.data.screening.steps import SAME, grid_step, smallest_step

#: The first bin holds this many times the second …
FULLER = 4.0
#: … and the second at most this many times the mean of the four below it; a parabola's has 1.6
#: times, a flatter top more.
LEVEL = 1.4
#: Fewest samples in the first bin where they are exactly equal.
FEWEST_EQUAL = 8
#: Fewest where they carry noise.
FEWEST_NEAR = 40
#: Where the values below the first occur once each, so often may equal ones be chance.
CHANCE = 1e-5
#: Values below the first that are compared with it.
BELOW = 8
#: Bins below the first that are compared with it.
BINS = 5
#: Widths of bins: the range over these powers of two.
WIDTHS = range(4, 13)
#: A rail is visited so often …
VISITS = 3
#: … unless its samples are exactly equal for longer than this.
LONG = 8
#: … and this part of its visits does not follow the one before it at one distance.
EVENLY = 0.9
#: A level that holds this part of the record in one piece is rest …
REST = 0.12
#: … and one that holds this part of it in all.
MOSTLY = 0.45
#: A signal whose two levels together hold more than this is square.
SQUARE = 0.9
#: Visits of so few samples are doubted in a signal that its neighbours tell well.
SHORT = 6.0
#: Neighbours on either side that tell a sample.
NEIGHBOURS = 3
#: They tell it well to this part of the signal's standard deviation.
PREDICTED = 0.1
#: A rail's samples are told so many times worse than the others.
STRANGE = 1.6
#: The samples beside a visit lead past it by this part of the range: less is the flat step of a
#: coarse generator.
LEAST_CUT = 2.5e-3
#: The smallest difference of values that occur is at most so many steps.
MOST_PARTS = 24


def clipped(
    values: FloatArray, valid: BoolArray, full_scale: float | None = None
) -> tuple[BoolArray, list[float]]:
    """Clipped samples with a guard on either side, shape (samples,), and the levels of the rails.

    Args:
        values: one channel, shape (samples,).
        valid: samples to look at, shape (samples,).
        full_scale: largest magnitude that the channel can hold; it then decides alone. None: the
            values tell.
    """
    if np.sum(valid) < 8:
        return np.zeros(values.shape, dtype=bool), []
    if full_scale is not None:
        found = valid & _beyond(values, full_scale, smallest_step(values[valid]))
        return _guarded(found), sorted({float(np.sign(v)) * full_scale for v in values[found]})
    ordered = np.sort(values[valid])
    tops = (1.0, ordered[::-1]), (-1.0, -ordered)
    rails = [
        (side, rail) for side, top in tops if (rail := _rail(side * values, valid, top)) is not None
    ]
    found = np.zeros(values.shape, dtype=bool)
    for side, rail in rails:
        found |= valid & (side * values >= rail)
    if np.sum(found) > SQUARE * np.sum(valid):
        return np.zeros(values.shape, dtype=bool), []
    levels = [float(np.median(values[valid & (side * values >= rail)])) for side, rail in rails]
    return _guarded(found), levels


def _beyond(values: FloatArray, full_scale: float, step: float) -> BoolArray:
    """At ± full scale; of a converter in two's complement the highest code lies one step below it."""
    coarse = (
        step > 2.0**-30 * full_scale and abs(full_scale / step - np.rint(full_scale / step)) < 1e-6
    )
    top = full_scale - step * 1.001 if coarse else full_scale * (1.0 - 1e-9)
    return (values >= top) | (values <= -full_scale * (1.0 - 1e-9))


def _rail(values: FloatArray, valid: BoolArray, top: FloatArray) -> float | None:
    """Lowest value that counts as at the upper rail; None if there is no rail. ``top``: the valid ones, falling."""
    span = float(top[0] - top[-1])
    if span == 0.0:
        return None
    found = _of_equal_values(values, valid, top, SAME * span)
    if found is not None:
        return found
    below = -top
    step = grid_step(below, MOST_PARTS)
    width = span * 0.5 ** np.array(WIDTHS)
    if step > 0.0:
        width = step * np.ceil(width / step)  # whole steps
    limits = float(top[0]) - width + 0.5 * step
    ends = np.searchsorted(below, np.multiply.outer(width, np.arange(BINS + 1)) - limits[:, None])
    counts = np.diff(ends, axis=1, prepend=0).astype(float)
    for index in np.flatnonzero(_piled(counts, FEWEST_NEAR)).tolist():
        limit = float(limits[index])
        wide = float(width[index])
        if counts[index, 0] <= FULLER * _fullest_below(top, limit, wide) or _is_staircase(
            top, wide
        ):
            continue
        inside = valid & (values > limit)
        if _runs(inside).size < VISITS or _in_step(inside) or _at_rest(inside, valid):
            continue
        if _confirmed(values, inside, valid):
            return limit
    return None


def _fullest_below(top: FloatArray, limit: float, width: float) -> float:
    """Most samples in a bin between the first and the middle: a generator's staircase fills others too."""
    below = top[(top <= limit) & (top > 0.5 * (top[0] + top[-1]))]
    return float(np.max(np.bincount(((limit - below) / width).astype(int)), initial=0))


def _is_staircase(top: FloatArray, width: float) -> bool:
    """Tell whether samples crowd at levels between the ends, other than the one where they rest.

    Of a signal that has few levels in all nothing else is known.
    """
    counts = np.bincount(((top[0] - top) / width + 0.5).astype(int)).astype(float)
    if counts.size < 2 * BINS:
        return True
    near = np.maximum(counts[:-4], counts[4:])
    levels = 2 + np.flatnonzero(counts[2:-2] > np.maximum(FULLER * near, FEWEST_NEAR))
    rest = int(np.argmax(counts[2:-2])) + 2
    return bool(np.any(np.abs(levels - rest) > 2))


def _of_equal_values(
    values: FloatArray, valid: BoolArray, top: FloatArray, same: float
) -> float | None:
    """The upper rail where its samples are exactly equal."""
    # Where each value begins in the sorted list, from the top.
    begins = np.concatenate([[0], 1 + np.flatnonzero(top[:-1] - top[1:] > same)])[: BELOW + 2]
    counts = np.diff(begins if begins.size == BELOW + 2 else np.append(begins, top.size)).astype(
        float
    )
    if counts.size <= BELOW:
        return None  # with a few levels the motion between them is not known
    most = float(np.max(counts[1:]))
    limit = float(top[0]) - same
    if counts[0] == most == 1.0:
        return None
    inside = valid & (values >= limit)
    if _in_step(inside):
        return None
    if most == 1.0:
        strange = _ties_by_chance(top, counts[0]) < CHANCE
        return limit if strange and not _at_rest(inside, valid) else None
    gaps = -np.diff(top[begins[: counts.size]])
    if gaps[0] > 1.5 * np.min(gaps) and counts[0] < 2.0 * FULLER * most:
        return None  # synchronous samples, which leave values out
    if counts[0] <= FULLER * most or not bool(_piled(counts, FEWEST_EQUAL)):
        return None
    if (_runs(inside).size < VISITS and np.max(_runs(inside)) < LONG) or _at_rest(inside, valid):
        return None
    return limit if _confirmed(values, inside, valid) else None


def _ties_by_chance(top: FloatArray, count: float) -> float:
    """Chance that so many values are equal at the top, by the distance of the values below them and the steps there.

    Numbers of few digits have finer steps farther down.
    """
    below = int(count) + BELOW - 1
    if below >= top.size:
        return 1.0
    distance = float(top[0] - top[below])
    return min(1.0, BELOW * grid_step(-top[: below + 32], MOST_PARTS) / distance) ** (count - 1.0)


def _piled(counts: FloatArray, fewest: int) -> BoolArray:
    """Whether the first of some bins from the top, along the last axis, is a rail's."""
    first = counts[..., 0]
    second = counts[..., 1]
    below = np.mean(counts[..., 2:6], axis=-1)
    doubt = np.where(first < 30.0 * fewest, 3.0 * np.sqrt(np.maximum(second, 1.0)), 0.0)
    return (first >= fewest) & (first > FULLER * second + doubt) & (second <= LEVEL * below + 2.0)


def _runs(flags: BoolArray) -> FloatArray:
    begins, ends = runs_of_true(flags)
    return (ends - begins).astype(float)


def _in_step(inside: BoolArray) -> bool:
    """Whether one or two samples are at the level in every so many: the tops of a tone in step with the sampling.

    They return exactly once the motion has settled, while values below them, of its beginning,
    occur once.
    """
    begins, ends = runs_of_true(inside)
    apart = np.diff(begins)
    if apart.size < VISITS - 1 or np.median(ends - begins) > 2:
        return False
    return float(np.mean(apart == np.median(apart))) > EVENLY


def _at_rest(inside: BoolArray, valid: BoolArray) -> bool:
    """Whether the level is where the signal rests."""
    share = float(np.sum(inside)) / float(np.sum(valid))
    if share > MOSTLY:
        return True
    # Noise may leave the level for a few samples.
    width = 9
    dense = np.convolve(inside, np.ones(width), mode="same") > 0.6 * width
    runs = _runs(dense)
    longest = float(np.max(runs, initial=0.0))
    usual = float(np.median(runs)) if runs.size else 0.0
    begins = bool(dense[width] or dense[-width - 1])
    return longest > REST * inside.size and (begins or runs.size < 4 or longest > 2.0 * usual)


def _confirmed(values: FloatArray, inside: BoolArray, valid: BoolArray) -> bool:
    """Whether the samples beside the visits lead past the level, or short visits are unlike the rest of the signal.

    A generator's stairs, and few samples a period in step with it, leave most values out, and the
    law of the bins with them; but the signal turns where its neighbours predict.
    """
    if np.median(_runs(inside)) > SHORT:
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
    near = _guarded(inside)[middle] & used
    apart = used & ~near
    if near.sum() < 3 or apart.sum() < 3:
        return True
    far = float(np.sqrt(np.mean(error[apart] ** 2)))
    if far > PREDICTED * float(np.std(values[valid])):
        return True
    return float(np.sqrt(np.mean(error[near] ** 2))) > STRANGE * max(
        far, smallest_step(values[valid])
    )


def _leads_past(values: FloatArray, inside: BoolArray) -> bool:
    """Whether a parabola through the samples on both sides of the longest visits passes beyond most of them."""
    begins, ends = runs_of_true(inside)
    visits = sorted(
        zip(begins.tolist(), ends.tolist(), strict=True), key=lambda run: run[0] - run[1]
    )
    past = []
    span = float(np.ptp(values))
    for first, end in visits[:15]:
        length = end - first
        stretch = max(3, (end - first) // 2)
        if first < stretch or end + stretch > values.size:
            continue
        times = np.concatenate([np.arange(-stretch, 0), length + np.arange(stretch)]) / length - 0.5
        sides = np.concatenate([values[first - stretch : first], values[end : end + stretch]])
        basis = np.stack([np.ones_like(times), times, times**2], axis=1)
        amounts, *_ = np.linalg.lstsq(basis, sides, rcond=None)
        misfit = float(np.sqrt(np.mean((sides - basis @ amounts) ** 2)))
        # Thrown to the level from far below it is no way for a free signal either.
        beyond = abs(float(amounts[0] - np.median(values[first:end])))
        past.append(beyond > max(float(np.ptp(values[first:end])), misfit, LEAST_CUT * span))
    return not past or sum(past) > 0.5 * len(past)


def _guarded(found: BoolArray) -> BoolArray:
    """With the samples beside them."""
    wide = found.copy()
    wide[1:] |= found[:-1]
    wide[:-1] |= found[1:]
    return wide

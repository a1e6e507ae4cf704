"""Find clipped samples: those that pile up at a rail of the converter or the amplifier.

Count the samples in bins of equal width, from the extreme value down. In a free signal a turn of
order n (a parabola has n = 2) spends a time t ∝ d^{1/n} within a distance d of its top. The first
bin therefore holds at most 1/(2^{1/n} − 1) times as many samples as the second, and the second
holds more than those below it. At a rail the first bin is far fuller than the second, and the
second is no fuller than those below it. This holds for any motion and needs no full scale. Where
the samples at the rail are exactly equal, the bins are the values that occur; where they carry
noise, the bins have some width.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import extend_flags, runs_of_true
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.steps import RELATIVE_EQUALITY, grid_step, smallest_step

#: At a rail the first bin holds at least this many times as many samples as the second.
MIN_FIRST_TO_SECOND = 4.0
#: At a rail the second bin holds at most this many times the mean of the four below it (1.6 times
#: for a parabola, more for a flatter top).
MAX_SECOND_TO_LOWER = 1.4
#: A first bin of few samples exceeds that ratio by this many standard deviations of the second
#: bin's count …
COUNT_DEVIATIONS = 3.0
#: … where "few" is less than this many times the fewest samples of a rail.
CERTAIN_COUNT_RATIO = 30.0
#: Fewest samples in the first bin where they are exactly equal.
MIN_EQUAL_SAMPLES = 8
#: Fewest samples in the first bin where they carry noise.
MIN_NOISY_SAMPLES = 40
#: Equal samples at the top are a rail below this chance, where every lower value occurs once.
CHANCE_OF_TIES = 1e-5
#: Values below the first that are compared with it.
VALUES_BELOW = 8
#: Bins below the first that are compared with it.
BINS_BELOW = 5
#: Widths of bins: the range over these powers of two.
WIDTH_POWERS = range(4, 13)
#: Fewest visits of a signal to a rail, unless one of them is long.
MIN_VISITS = 3
#: Fewest samples of a long visit.
LONG_VISIT_SAMPLES = 8
#: Evenly spaced share of the visits above which a level is synchronous sampling, not a rail.
EVENLY_SPACED_SHARE = 0.9
#: Share of the record in one run above which a level is the level of rest.
REST_SHARE_IN_ONE_PIECE = 0.12
#: Share of the record in all above which a level is the level of rest.
REST_SHARE_IN_ALL = 0.45
#: Samples over which the level of rest is averaged: noise may leave it for a few samples.
REST_WINDOW_SAMPLES = 9
#: Share of the samples at two levels above which the signal is a square wave.
SQUARE_WAVE_SHARE = 0.9
#: Treads of one signal are alike in length within this ratio.
MAX_TREAD_RATIO = 4.0
#: Longest visits that are doubted in a signal which neighbouring samples predict well.
MAX_SHORT_VISIT_SAMPLES = 6.0
#: Neighbours on either side that predict a sample.
NEIGHBOURS = 3
#: Largest error of a good prediction, relative to the signal's standard deviation.
MAX_PREDICTION_ERROR = 0.1
#: Smallest ratio of the prediction errors at a rail to those elsewhere.
MIN_ERROR_RATIO = 1.6
#: Smallest overshoot of the motion past a rail, relative to the range: less is the flat step of a
#: coarse generator.
MIN_OVERSHOOT = 2.5e-3
#: Longest visits whose overshoot is examined.
MAX_EXAMINED_VISITS = 15
#: Smallest step of a converter, relative to its full scale: 30 bits.
MIN_STEP_OF_FULL_SCALE = 2.0**-30
#: Largest smallest difference between values that occur, in steps of the converter.
MAX_STEPS_IN_DIFFERENCE = 24
#: The same of a few values at the top, which lie far apart where a converter is fine.
MAX_STEPS_AT_TOP = 1000


def find_clipped(
    channel: ChannelSamples, full_scale: float | None = None
) -> tuple[BoolArray, list[float]]:
    """Return the clipped samples with a guard sample on either side, and the levels of the rails.

    Args:
        channel: the samples to look at.
        full_scale: largest magnitude that the channel can hold, which then decides alone; None: the
            values decide.

    Returns:
        flags, shape (samples,), and levels in the unit of the values.
    """
    values = channel.values
    valid = channel.valid
    unclipped = np.zeros(values.shape, dtype=bool), list[float]()
    if channel.ordered.size < 8:
        return unclipped
    if full_scale is not None:
        flags = valid & _at_full_scale(values, full_scale, smallest_step(values[valid]))
        signs = {float(np.sign(value)) for value in values[flags]}
        return extend_flags(flags, 1), sorted(sign * full_scale for sign in signs)
    step = functools.cache(lambda: grid_step(channel.ordered, MAX_STEPS_IN_DIFFERENCE))
    clipped = []  # flags of the samples at each rail
    for upright in (channel, channel.upside_down):
        rail = _find_rail(upright, step)
        if rail is not None:
            clipped.append(valid & (upright.values >= rail))
    if not clipped:
        return unclipped
    flags = np.any(clipped, axis=0)
    if np.sum(flags) > SQUARE_WAVE_SHARE * np.sum(valid) or _has_treads_between(channel, flags):
        return unclipped
    return extend_flags(flags, 1), [float(np.median(values[at_rail])) for at_rail in clipped]


def _has_treads_between(channel: ChannelSamples, at_rails: BoolArray) -> bool:
    """Return whether a signal rests between its rails as it does at them: it was commanded so.

    Ramps between the levels, as of an amplifier behind a generator, hide that they are stairs. The
    rest between the bursts of a clipped tone lasts far longer than its stay at a rail.
    """
    equal = np.diff(channel.values) == 0.0
    equal &= channel.valid[1:] & channel.valid[:-1]
    begins, ends = runs_of_true(equal)
    lengths = ends - begins + 1
    is_between = (lengths >= LONG_VISIT_SAMPLES) & ~at_rails[begins]
    levels, counts = np.unique(channel.values[begins[is_between]], return_counts=True)
    if not counts.size or np.max(counts) < MIN_VISITS:
        return False
    is_at_level = is_between & (channel.values[begins] == levels[np.argmax(counts)])
    ratio = float(np.median(lengths[is_at_level]) / np.median(_run_lengths(at_rails)))
    return 1.0 / MAX_TREAD_RATIO < ratio < MAX_TREAD_RATIO


def _at_full_scale(values: FloatArray, full_scale: float, step: float) -> BoolArray:
    """Return which values are at ± full scale.

    The highest code of a converter in two's complement lies one step below full scale.
    """
    is_stepped = step > MIN_STEP_OF_FULL_SCALE * full_scale
    has_codes = is_stepped and abs(full_scale / step - np.rint(full_scale / step)) < 1e-6
    bottom = -full_scale * (1.0 - 1e-9)
    top = full_scale - step * 1.001 if has_codes else -bottom
    return (values >= top) | (values <= bottom)


def _find_rail(channel: ChannelSamples, step_of_grid: Callable[[], float]) -> float | None:
    """Return the lowest value that counts as at the upper rail; None if there is no rail.

    Args:
        channel: upside down for its lower rail.
        step_of_grid: returns the step of the grid on which its values lie, zero without one.
    """
    span = channel.span
    if span == 0.0:
        return None
    values = channel.values
    valid = channel.valid
    falling = channel.ordered[::-1]
    if channel.ties:
        rail = _find_rail_of_equal_values(values, valid, falling, RELATIVE_EQUALITY * span)
        if rail is not None:
            return rail
    step = step_of_grid()
    widths = span * 0.5 ** np.array(WIDTH_POWERS)
    if step > 0.0:
        widths = step * np.ceil(widths / step)
    limits = float(falling[0]) - widths + 0.5 * step
    bin_ends = limits[:, None] - np.multiply.outer(widths, np.arange(-1, BINS_BELOW + 1))
    bin_ends[:, 0] = np.inf
    above = np.searchsorted(channel.ordered, bin_ends, side="right")
    counts = (above[:, :-1] - above[:, 1:]).astype(float)
    for index in np.flatnonzero(_is_piled_up(counts, MIN_NOISY_SAMPLES)).tolist():
        limit = float(limits[index])
        width = float(widths[index])
        fullest = _fullest_bin_below(falling, limit, width)
        if counts[index, 0] <= MIN_FIRST_TO_SECOND * fullest or _is_staircase(falling, width):
            continue
        at_rail = valid & (values > limit)
        if (
            _run_lengths(at_rail).size >= MIN_VISITS
            and not _is_synchronous(at_rail)
            and not _is_rest_level(at_rail, valid)
            and _is_confirmed(values, at_rail, valid)
        ):
            return limit
    return None


def _fullest_bin_below(falling: FloatArray, limit: float, width: float) -> float:
    """Return the count of the fullest bin between the first and the middle of the range.

    A generator's staircase fills such bins, too.
    """
    lower = falling[(falling <= limit) & (falling > 0.5 * (falling[0] + falling[-1]))]
    return float(np.max(np.bincount(((limit - lower) / width).astype(int)), initial=0))


def _is_staircase(falling: FloatArray, width: float) -> bool:
    """Return whether samples crowd at levels between the ends, except the level of rest.

    True for a signal with few levels in all, of which nothing else is known.
    """
    counts = np.bincount(((falling[0] - falling) / width + 0.5).astype(int)).astype(float)
    if counts.size < 2 * BINS_BELOW:
        return True
    inner = counts[2:-2]
    surroundings = np.maximum(counts[:-4], counts[4:])
    levels = np.flatnonzero(
        inner > np.maximum(MIN_FIRST_TO_SECOND * surroundings, MIN_NOISY_SAMPLES)
    )
    return bool(np.any(np.abs(levels - np.argmax(inner)) > 2))


def _find_rail_of_equal_values(
    values: FloatArray, valid: BoolArray, falling: FloatArray, tolerance: float
) -> float | None:
    """Return the upper rail where its samples are exactly equal; None if there is no rail."""
    changes = 1 + np.flatnonzero(falling[:-1] - falling[1:] > tolerance)
    first_index = np.concatenate([[0], changes, [falling.size]])[: VALUES_BELOW + 2]
    counts = np.diff(first_index).astype(float)  # of each value that occurs, from the top
    if counts.size <= VALUES_BELOW:
        return None  # with a few levels the motion between them is not known
    most = float(np.max(counts[1:]))
    if counts[0] == most == 1.0:
        return None
    limit = float(falling[0]) - tolerance
    at_rail = valid & (values >= limit)
    if _is_synchronous(at_rail):
        return None
    if most == 1.0:
        is_unlikely = _chance_of_ties(falling, counts[0]) < CHANCE_OF_TIES
        return limit if is_unlikely and not _is_rest_level(at_rail, valid) else None
    gaps = -np.diff(falling[first_index[: counts.size]])
    if gaps[0] > 1.5 * np.min(gaps) and counts[0] < 2.0 * MIN_FIRST_TO_SECOND * most:
        return None  # synchronous samples, which leave values out
    if counts[0] <= MIN_FIRST_TO_SECOND * most or not _is_piled_up(counts, MIN_EQUAL_SAMPLES):
        return None
    visits = _run_lengths(at_rail)
    if visits.size < MIN_VISITS and np.max(visits) < LONG_VISIT_SAMPLES:
        return None
    if _is_rest_level(at_rail, valid) or not _is_confirmed(values, at_rail, valid):
        return None
    return limit


def _chance_of_ties(falling: FloatArray, count: float) -> float:
    """Return the chance that ``count`` values are equal at the top.

    It follows from the distance of the values below them and the step of the values there: numbers
    of few digits have finer steps farther down.
    """
    last = int(count) + VALUES_BELOW - 1
    if last >= falling.size:
        return 1.0
    distance = float(falling[0] - falling[last])
    step = grid_step(-falling[: last + 32], MAX_STEPS_AT_TOP)
    return min(1.0, VALUES_BELOW * step / distance) ** (count - 1.0)


def _is_piled_up(counts: FloatArray, min_count: int) -> BoolArray:
    """Return whether the first of the bins from the top, along the last axis, is a rail's.

    ``min_count``: fewest samples of a rail.
    """
    first = counts[..., 0]
    second = counts[..., 1]
    is_full = (first >= min_count) & (first > MIN_FIRST_TO_SECOND * second)
    if not is_full.any():
        return is_full
    lower = np.mean(counts[..., 2:6], axis=-1)
    scatter = COUNT_DEVIATIONS * np.sqrt(np.maximum(second, 1.0))
    allowance = np.where(first < CERTAIN_COUNT_RATIO * min_count, scatter, 0.0)
    return (
        is_full
        & (first > MIN_FIRST_TO_SECOND * second + allowance)
        & (second <= MAX_SECOND_TO_LOWER * lower + 2.0)
    )


def _run_lengths(flags: BoolArray) -> FloatArray:
    begins, ends = runs_of_true(flags)
    return (ends - begins).astype(float)


def _is_synchronous(at_level: BoolArray) -> bool:
    """Return whether one or two samples reach the level in each period, in step with the sampling.

    These tops of a tone return exactly once the motion has settled, while the values below them,
    from its beginning, occur once.
    """
    begins, ends = runs_of_true(at_level)
    intervals = np.diff(begins)
    if intervals.size < MIN_VISITS - 1 or np.median(ends - begins) > 2:
        return False
    return float(np.mean(intervals == np.median(intervals))) > EVENLY_SPACED_SHARE


def _is_rest_level(at_level: BoolArray, valid: BoolArray) -> bool:
    """Return whether the signal rests at the level, be it before or after a one-sided motion."""
    share = float(np.sum(at_level)) / float(np.sum(valid))
    is_one_end = _run_lengths(at_level).size == 1 and (at_level[0] or at_level[-1])
    if share > REST_SHARE_IN_ALL or is_one_end:
        return True
    width = REST_WINDOW_SAMPLES
    dense = np.convolve(at_level, np.ones(width), mode="same") > 0.6 * width
    runs = _run_lengths(dense)
    longest = float(np.max(runs, initial=0.0))
    if longest <= REST_SHARE_IN_ONE_PIECE * at_level.size:
        return False
    is_at_an_end = bool(dense[width] or dense[-width - 1])
    return is_at_an_end or runs.size < 4 or longest > 2.0 * float(np.median(runs))


def _is_confirmed(values: FloatArray, at_rail: BoolArray, valid: BoolArray) -> bool:
    """Return whether the motion around the visits confirms a rail.

    Long visits: the samples around them lead past the level. Short visits: neighbours predict their
    samples worse than the rest of the signal. The stairs of a generator, and a signal of few
    samples a period, leave most values out, which breaks the law of the bins; but such a signal
    turns where its neighbours predict.
    """
    if np.median(_run_lengths(at_rail)) > MAX_SHORT_VISIT_SAMPLES:
        return _leads_past(values, at_rail)
    inner = slice(NEIGHBOURS, values.size - NEIGHBOURS)
    error, is_predicted = _prediction_errors(values, valid)
    near_rail = extend_flags(at_rail, 1)[inner] & is_predicted
    elsewhere = is_predicted & ~near_rail
    if is_predicted.sum() < 4 * NEIGHBOURS or near_rail.sum() < 3 or elsewhere.sum() < 3:
        return True
    usual = float(np.sqrt(np.mean(error[elsewhere] ** 2)))
    if usual > MAX_PREDICTION_ERROR * float(np.std(values[valid])):
        return True
    limit = MIN_ERROR_RATIO * max(usual, smallest_step(values[valid]))
    return float(np.sqrt(np.mean(error[near_rail] ** 2))) > limit


def _prediction_errors(values: FloatArray, valid: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return each sample less its prediction from NEIGHBOURS on either side, by least squares.

    Returns:
        the errors, and which of them have all their samples valid; shape (samples − 2 NEIGHBOURS,),
        without the samples at either end.
    """
    count = values.size - 2 * NEIGHBOURS
    shifted = [values[shift : shift + count] for shift in range(2 * NEIGHBOURS + 1)]
    is_predicted = ~extend_flags(~valid, NEIGHBOURS)[NEIGHBOURS : NEIGHBOURS + count]
    pairs = [shifted[NEIGHBOURS - k] + shifted[NEIGHBOURS + k] for k in range(1, NEIGHBOURS + 1)]
    design = np.stack([np.ones(count), *pairs], axis=1)
    target = shifted[NEIGHBOURS]
    coefficients, *_ = np.linalg.lstsq(design[is_predicted], target[is_predicted], rcond=1e-12)
    return target - design @ coefficients, is_predicted


def _leads_past(values: FloatArray, at_rail: BoolArray) -> bool:
    """Return whether most parabolas through the samples around the longest visits pass the level.

    Also True where no visit has enough samples around it.
    """
    visits = [(int(first), int(end)) for first, end in zip(*runs_of_true(at_rail), strict=True)]
    visits.sort(key=lambda visit: visit[0] - visit[1])
    passes = []
    span = float(np.ptp(values))
    for first, end in visits[:MAX_EXAMINED_VISITS]:
        length = end - first
        margin = max(3, length // 2)
        if first < margin or end + margin > values.size:
            continue
        index = np.concatenate([np.arange(first - margin, first), np.arange(end, end + margin)])
        times = (index - first) / length - 0.5
        surroundings = values[index]
        basis = np.stack([np.ones_like(times), times, times**2], axis=1)
        coefficients, *_ = np.linalg.lstsq(basis, surroundings, rcond=None)
        misfit = float(np.sqrt(np.mean((surroundings - basis @ coefficients) ** 2)))
        visit = values[first:end]
        # A free signal does not jump to the level from far below it either.
        overshoot = abs(float(coefficients[0] - np.median(visit)))
        passes.append(overshoot > max(float(np.ptp(visit)), misfit, MIN_OVERSHOOT * span))
    return not passes or sum(passes) > 0.5 * len(passes)

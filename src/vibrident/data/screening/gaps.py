"""Find samples that a recorder lost: held at the last value, or set to zero or another constant.

Measured values are seldom equal to their neighbours. Where they are noise in fine steps, a few
equal in a row are beyond chance. Where they are often equal (coarse steps, a slow turn, a
staircase), a free signal that stays for long moves slowly there, and leaves by a step like the
others; a held one leaves by a jump. At an end of the record a free signal may rest, but not where
the motion goes on.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import distinct, runs_of_true
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.steps import RELATIVE_EQUALITY, converter_step, smallest_step

#: Fewest equal samples in a row that are examined.
MIN_EQUAL_SAMPLES = 3
#: Expected number of false findings in a record.
MAX_FALSE_FINDINGS = 1e-4
#: Samples on either side that show how the channel changes.
NEIGHBOURS = 30
#: Quantile of these changes that stands for the usual one: motion may rest for most of them.
USUAL_CHANGE_QUANTILE = 0.25
#: A jump is this many times the usual largest change of a channel of coarse steps …
JUMP_RATIO = 4.0
#: … which this share of the changes exceed.
SHARE_OF_LARGE_CHANGES = 0.02
#: A stay at one level for more than this share of the record is rest.
MAX_STAY_SHARE = 0.25


def find_lost_samples(
    channel: ChannelSamples,
    other_channel: ChannelSamples | None = None,
    *,
    motion_goes_on: bool = False,
) -> BoolArray:
    """Return the samples that a recorder lost, shape (samples,).

    A run of equal samples ends where one is not valid.

    Args:
        channel: that is looked at.
        other_channel: of the same record; None: no other.
        motion_goes_on: the motion neither begins nor ends within the record.
    """
    values = channel.values
    valid = channel.valid
    flags = np.zeros(values.shape, dtype=bool)
    if channel.ties < MIN_EQUAL_SAMPLES - 1:
        return flags
    grid = RELATIVE_EQUALITY * channel.span
    values = np.rint(values / grid) if grid > 0.0 else values
    equal = (np.diff(values) == 0.0) & valid[1:] & valid[:-1]
    begins, ends = runs_of_true(equal)
    lengths = ends - begins + 1
    long_enough = lengths >= MIN_EQUAL_SAMPLES
    if not long_enough.any():
        return flags
    rest_levels = _levels_of_rest(values, begins, ends)
    is_inside = (begins > 0) & (ends < values.size - 1)
    candidate = long_enough & (lengths <= MAX_STAY_SHARE * values.size)
    candidate &= np.where(is_inside, ~np.isin(values[begins], rest_levels), motion_goes_on)
    # The share of values that return at once: most of a held signal's, whatever its neighbours do.
    returning = (begins.size - 1.0) / (values.size - np.count_nonzero(equal))
    jumps = candidate & _bounded_by_jump(values, begins, ends)
    rare = candidate & ~jumps & (values.size * returning ** (lengths - 1.0) < MAX_FALSE_FINDINGS)
    step = smallest_step(values) if rare.any() else 0.0
    other_step = smallest_step(other_channel.values) if other_channel and rare.any() else 0.0
    for index in np.flatnonzero(rare):
        run = int(begins[index]), int(ends[index])
        chance = _chance_of_equal(values, *run, step)
        surprises = _surprises(other_channel, *run, other_step)
        unlikely = values.size * chance**surprises < MAX_FALSE_FINDINGS
        rare[index] = unlikely and not (is_inside[index] and _rests_beside(values, *run, step))
    candidate = jumps | rare
    for first, last in zip(begins[candidate], ends[candidate], strict=True):
        flags[first : last + 1] = True
    return flags


def _chance_of_equal(values: FloatArray, first: int, last: int, step: float) -> float:
    """Return the chance that a sample equals the one before it.

    It follows from the changes of the channel on either side of the run and from their step.
    """
    before = np.abs(np.diff(values[max(first - NEIGHBOURS, 0) : first + 1]))[:-1]
    after = np.abs(np.diff(values[last : last + NEIGHBOURS]))[1:]
    changes = np.concatenate([before, after, [0.0]])
    usual = float(np.quantile(changes, USUAL_CHANGE_QUANTILE))
    neighbourhood = values[max(first - NEIGHBOURS, 0) : last + NEIGHBOURS]
    # Numbers of a fixed number of digits have coarser steps where they are large.
    step = max(step, converter_step(neighbourhood))
    return min(1.0, step / usual) if usual > 0.0 else 1.0


def _sets_off(values: FloatArray, first: int, last: int) -> bool:
    """Return whether a channel leaves a run at an end of the record as slowly as from rest."""
    outside = values[last + 1 : last + 3] if first == 0 else values[first - 2 : first]
    usual = float(np.quantile(np.abs(np.diff(values)), USUAL_CHANGE_QUANTILE))
    return float(np.max(np.abs(outside - values[first]))) <= usual


def _surprises(
    other_channel: ChannelSamples | None, first: int, last: int, other_step: float
) -> int:
    """Return the count of samples in a run that equal the one before, though motion goes on.

    Before the other channel begins to move, and after it has come to rest, they are no surprise,
    unless it jumps at that end of the record, too.
    """
    if other_channel is None:
        return last - first
    values = other_channel.values
    is_at_end = first == 0 or last == values.size - 1
    if not _rests_beside(values, first, last, other_step) or (
        is_at_end and not _sets_off(values, first, last)
    ):
        return last - first
    changes = np.abs(np.diff(values[first : last + 1]))
    return int(np.count_nonzero(changes > RELATIVE_EQUALITY * other_channel.span))


def _rests_beside(values: FloatArray, first: int, last: int, step: float) -> bool:
    """Return whether a channel is within a step of a run from the first sample, or to the last.

    The motion has not begun then, or is over.
    """
    level = values[first]
    return any(
        bool(np.all(np.abs(side - level) < 1.5 * step)) for side in (values[:first], values[last:])
    )


def _levels_of_rest(values: FloatArray, begins: np.ndarray, ends: np.ndarray) -> FloatArray:
    """Return the levels that are held for long, or at the very begin or end of the record."""
    lengths = ends - begins + 1
    edge = ((begins == 0) | (ends == values.size - 1)) & (lengths >= 2 * MIN_EQUAL_SAMPLES)
    return distinct(values[begins[edge | (lengths > MAX_STAY_SHARE * values.size)]])


def _bounded_by_jump(values: FloatArray, begins: np.ndarray, ends: np.ndarray) -> BoolArray:
    """Return which runs begin or end with a change far beyond the others of the channel."""
    inner = (begins > 0) & (ends < values.size - 1)
    into = np.abs(values[begins] - values[np.maximum(begins - 1, 0)])
    out = np.abs(values[np.minimum(ends + 1, values.size - 1)] - values[ends])
    change = np.abs(np.diff(values))
    change = change[change > 0.0]
    if change.size < 8:
        return np.zeros(begins.shape, dtype=bool)
    usual = JUMP_RATIO * float(np.quantile(change, 1.0 - SHARE_OF_LARGE_CHANGES))
    return inner & (ends - begins >= MIN_EQUAL_SAMPLES) & (np.maximum(into, out) > usual)

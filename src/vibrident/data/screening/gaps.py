"""Stretches that a recorder lost: held at the last value, or set to zero or another constant.

Measured values are seldom equal to their neighbours. Where they are noise in fine steps, a few
equal in a row are beyond chance. Where they are often equal (coarse steps, a slow turn, a
staircase), a free signal that stays for long moves slowly there, and leaves by a step like the
others; a held one leaves by a jump.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import distinct, runs_of_true
from vibrident.data.screening.steps import SAME, converter_step, smallest_step

#: Equal samples in a row that are looked at.
FEWEST = 3
#: How often chance may make a finding, in a record.
CHANCE = 1e-4
#: Samples on either side that tell how the channel changes.
AROUND = 30
#: A jump is this many times the usual largest change of a channel of coarse steps …
JUMP = 4.0
#: … which this part of the changes exceed.
OTHERS = 0.02
#: A longer stay at one level than this part of the record is rest.
REST = 0.25


def lost(values: FloatArray, valid: BoolArray) -> BoolArray:
    """Samples of stretches that were lost, shape (samples,).

    Args:
        values: one channel, shape (samples,).
        valid: samples to look at, shape (samples,); a run ends where one is not.
    """
    found = np.zeros(values.shape, dtype=bool)
    grid = SAME * float(np.ptp(values[valid])) if valid.any() else 0.0
    values = np.rint(values / grid) if grid > 0.0 else values
    equal = (np.diff(values) == 0.0) & valid[1:] & valid[:-1]
    begins, ends = runs_of_true(equal)
    lengths = ends - begins + 1
    long = lengths >= FEWEST
    if not long.any():
        return found
    rest = _levels_of_rest(values, begins, ends)
    candidate = long & (lengths <= REST * values.size) & (begins > 0) & (ends < values.size - 1)
    candidate &= ~np.isin(values[begins], rest)
    # Of the values that occur, so many return at once: of a held signal most, whatever its
    # neighbours do.
    returning = (begins.size - 1.0) / (values.size - np.count_nonzero(equal))
    jumps = candidate & _leaves_by_jump(values, begins, ends)
    rare = candidate & ~jumps & (values.size * returning ** (lengths - 1.0) < CHANCE)
    step = smallest_step(values) if rare.any() else 0.0
    for index in np.flatnonzero(rare):
        chance = _chance_of_equal(values, int(begins[index]), int(ends[index]), step)
        rare[index] = values.size * chance ** (lengths[index] - 1.0) < CHANCE
    candidate = jumps | rare
    for first, last in zip(begins[candidate], ends[candidate], strict=True):
        found[first : last + 1] = True
    return found


def _chance_of_equal(values: FloatArray, first: int, last: int, step: float) -> float:
    """Chance that a sample equals the one before it, by how the channel changes on either side of a run."""
    before = np.abs(np.diff(values[max(first - AROUND, 0) : first + 1]))[:-1]
    after = np.abs(np.diff(values[last : last + AROUND]))[1:]
    usual = float(np.quantile(np.concatenate([before, after, [0.0]]), 0.25))
    here = values[max(first - AROUND, 0) : last + AROUND]
    # numbers of so many digits have coarser steps where they are large
    step = max(step, converter_step(here))
    return min(1.0, step / usual) if usual > 0.0 else 1.0


def _levels_of_rest(values: FloatArray, begins: np.ndarray, ends: np.ndarray) -> FloatArray:
    """Where the signal rests: at a level held for long, or at the record's very beginning or end."""
    lengths = ends - begins + 1
    edge = ((begins == 0) | (ends == values.size - 1)) & (lengths >= 2 * FEWEST)
    return distinct(values[begins[edge | (lengths > REST * values.size)]])


def _leaves_by_jump(values: FloatArray, begins: np.ndarray, ends: np.ndarray) -> BoolArray:
    """Whether a run begins or ends with a change far beyond the others of the channel."""
    inner = (begins > 0) & (ends < values.size - 1)
    into = np.abs(values[begins] - values[np.maximum(begins - 1, 0)])
    out = np.abs(values[np.minimum(ends + 1, values.size - 1)] - values[ends])
    change = np.abs(np.diff(values))
    change = change[change > 0.0]
    if change.size < 8:
        return np.zeros(begins.shape, dtype=bool)
    usual = JUMP * float(np.quantile(change, 1.0 - OTHERS))
    return inner & (ends - begins >= FEWEST) & (np.maximum(into, out) > usual)

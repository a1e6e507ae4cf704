"""Blocks that a recorder wrote twice: a stretch of a channel that returns, sample by sample, later in the record.

Measured samples never return for long, as noise is not the same twice. A generator's may, as may
those of a converter with coarse steps: then they return elsewhere, too, or what is beside them
returns nearly, and nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import runs_of_true
from vibrident.data.screening.gaps import CHANCE

#: Samples in a row that are looked for, and how many of them at least differ from the one before.
WINDOW = 32
CHANGING = 12
#: Samples on either side of a block that must be unlike those beside its copy …
BESIDE = 8
#: … by so many steps of the converter and this part of the block's standard deviation, as a median.
STEPS = 4.0
UNLIKE = 0.01
#: A window's key is the value of a polynomial at an odd number, modulo 2^64 (Karp & Rabin 1987):
#: its powers by half the length of a window that two of that half are joined to.
_POWERS = {half: np.uint64(pow(0x9E3779B97F4A7C15, half, 1 << 64)) for half in (1, 2, 4, 8, 16)}


@dataclass(frozen=True)
class Repeat:
    """A block and its copy, by their first samples; both have ``length`` samples."""

    first: int
    second: int
    length: int


def repeated_block(values: FloatArray, valid: BoolArray) -> Repeat | None:
    """The longest block of a channel that was written twice; None without one.

    Args:
        values: shape (samples,).
        valid: samples to look at, shape (samples,).
    """
    if values.size < 4 * WINDOW:
        return None
    change = np.diff(values, prepend=values[0])
    distance = _distance(values, valid, change)
    return None if distance is None else _longest(values, valid, change, distance)


def _distance(values: FloatArray, valid: BoolArray, change: FloatArray) -> int | None:
    """The distance at which most windows of samples return; None where none does."""
    keys = np.ascontiguousarray(values + 0.0, dtype=float).view(np.uint64)
    # coarse values differ in their upper bits only
    keys = (keys ^ (keys >> np.uint64(32))) * _POWERS[1]
    keys ^= keys >> np.uint64(29)
    for half, power in _POWERS.items():  # two windows side by side make one of twice the length
        keys = keys[:-half] * power + keys[half:]
    ordered = np.sort(keys)
    if not np.any(ordered[1:] == ordered[:-1]):
        return None
    sums = [np.cumsum(np.concatenate([[0], flags])) for flags in (~valid, change != 0.0)]
    unused, moving = (total[WINDOW:] - total[:-WINDOW] for total in sums)
    places = np.flatnonzero((unused == 0) & (moving >= CHANGING))
    order = places[np.argsort(keys[places], kind="stable")]
    same = keys[order[1:]] == keys[order[:-1]]
    distance, often = np.unique(np.diff(order)[same], return_counts=True)
    return int(distance[np.argmax(often)]) if often.size else None


def _longest(
    values: FloatArray, valid: BoolArray, change: FloatArray, distance: int
) -> Repeat | None:
    """The longest block that returns at this distance, and nowhere else does anything."""
    equal = (values[distance:] == values[:-distance]) & valid[distance:] & valid[:-distance]
    begins, ends = runs_of_true(equal)
    if begins.size == 0:
        return None  # two windows had one key by chance
    longest = int(np.argmax(ends - begins))
    first = int(begins[longest])
    end = int(ends[longest])
    if end - first > distance + BESIDE:
        return None  # a periodic motion
    moving = change[distance:] != 0.0
    moving[first:end] = False
    elsewhere = float(np.mean(equal[moving])) if moving.any() else 1.0
    if not _by_chance(change, first, end, elsewhere) < CHANCE:
        return None
    step = float(np.min(np.abs(change[change != 0.0])))
    unlike = max(STEPS * step, UNLIKE * float(np.std(values[first:end])))
    for side in (slice(max(first - BESIDE, 0), first), slice(end, end + BESIDE)):
        apart = np.abs(values[distance:][side] - values[:-distance][side])
        if apart.size and float(np.median(apart)) <= unlike:
            return None
    return Repeat(first, first + distance, end - first)


def _by_chance(change: FloatArray, first: int, end: int, elsewhere: float) -> float:
    """Expected number of such repeats in a record, by how often each of the block's changes occurs in it."""
    _, which, often = np.unique(change, return_inverse=True, return_counts=True)
    part = np.maximum(often[which[first + 1 : end]] / change.size, elsewhere)
    return float(np.exp(2.0 * np.log(change.size) + np.sum(np.log(part))))

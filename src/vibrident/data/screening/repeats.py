"""Find blocks that a recorder wrote twice: samples of a channel that return later in the record.

Measured samples never return for long, as noise is not the same twice. A generator's may, as may
those of a converter with coarse steps: then they return elsewhere, too, or their neighbours nearly
return, and there is no finding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import runs_of_true
from vibrident.data.screening.channel import ChannelSamples
from vibrident.data.screening.gaps import MAX_FALSE_FINDINGS

#: Length of the windows that are compared, and how many of a window's samples differ from the one
#: before at least.
WINDOW_SAMPLES = 32
MIN_CHANGING_SAMPLES = 12
#: Samples on either side of a block that must differ from those beside its copy …
NEIGHBOURS = 8
#: … in the median, by so many steps of the converter and standard deviations of the block.
MIN_UNLIKE_STEPS = 4.0
MIN_UNLIKE_DEVIATIONS = 0.01
#: A window's key is the value of a polynomial at an odd number, modulo 2^64 (Karp & Rabin 1987):
#: its powers by half the length of a window that two of that half are joined to.
_POWERS = {half: np.uint64(pow(0x9E3779B97F4A7C15, half, 1 << 64)) for half in (1, 2, 4, 8, 16)}


@dataclass(frozen=True)
class Repeat:
    """A block and its copy, by their first samples; both have ``length`` samples."""

    first: int
    second: int
    length: int


def repeated_block(channel: ChannelSamples) -> Repeat | None:
    """Return the longest block of a channel that was written twice; None without one."""
    values = channel.values
    valid = channel.valid
    if values.size < 4 * WINDOW_SAMPLES:
        return None
    # Each sample of a window that returns has an equal.
    if channel.ties < WINDOW_SAMPLES:
        return None
    change = np.diff(values, prepend=values[0])
    distance = _repeat_distance(values, valid, change)
    return None if distance is None else _longest_repeat(values, valid, change, distance)


def _repeat_distance(values: FloatArray, valid: BoolArray, change: FloatArray) -> int | None:
    """Return the distance at which most windows of samples return; None where none does."""
    keys = np.ascontiguousarray(values + 0.0, dtype=float).view(np.uint64)
    # Coarse values differ in their upper bits only.
    keys = (keys ^ (keys >> np.uint64(32))) * _POWERS[1]
    keys ^= keys >> np.uint64(29)
    for half, power in _POWERS.items():  # two windows side by side make one of twice the length
        keys = keys[:-half] * power + keys[half:]
    ordered = np.sort(keys)
    if not np.any(ordered[1:] == ordered[:-1]):
        return None
    sums = [np.cumsum(np.concatenate([[0], flags])) for flags in (~valid, change != 0.0)]
    unused, moving = (total[WINDOW_SAMPLES:] - total[:-WINDOW_SAMPLES] for total in sums)
    candidates = np.flatnonzero((unused == 0) & (moving >= MIN_CHANGING_SAMPLES))
    order = candidates[np.argsort(keys[candidates], kind="stable")]
    same = keys[order[1:]] == keys[order[:-1]]
    distance, counts = np.unique(np.diff(order)[same], return_counts=True)
    return int(distance[np.argmax(counts)]) if counts.size else None


def _longest_repeat(
    values: FloatArray, valid: BoolArray, change: FloatArray, distance: int
) -> Repeat | None:
    """Return the longest block that returns at this distance.

    None if chance or periodic motion explains it.
    """
    equal = (values[distance:] == values[:-distance]) & valid[distance:] & valid[:-distance]
    begins, ends = runs_of_true(equal)
    if begins.size == 0:
        return None  # two windows had one key by chance
    longest = int(np.argmax(ends - begins))
    first = int(begins[longest])
    end = int(ends[longest])
    if end - first > distance + NEIGHBOURS:
        return None  # a periodic motion
    moving = change[distance:] != 0.0
    moving[first:end] = False
    elsewhere = float(np.mean(equal[moving])) if moving.any() else 1.0
    if not _expected_by_chance(change, first, end, elsewhere) < MAX_FALSE_FINDINGS:
        return None
    step = float(np.min(np.abs(change[change != 0.0])))
    unlike = max(MIN_UNLIKE_STEPS * step, MIN_UNLIKE_DEVIATIONS * float(np.std(values[first:end])))
    for side in (slice(max(first - NEIGHBOURS, 0), first), slice(end, end + NEIGHBOURS)):
        apart = np.abs(values[distance:][side] - values[:-distance][side])
        if apart.size and float(np.median(apart)) <= unlike:
            return None
    return Repeat(first, first + distance, end - first)


def _expected_by_chance(change: FloatArray, first: int, end: int, elsewhere: float) -> float:
    """Return the expected number of such repeats in a record by chance.

    Each of the block's changes has the chance of its frequency in the record, or ``elsewhere``: the
    share of other moving samples that return at this distance.
    """
    _, inverse, counts = np.unique(change, return_inverse=True, return_counts=True)
    chances = np.maximum(counts[inverse[first + 1 : end]] / change.size, elsewhere)
    return float(np.exp(2.0 * np.log(change.size) + np.sum(np.log(chances))))

"""Lengths of signals that transform fast."""

from __future__ import annotations

import functools

import numpy as np

#: Largest part of its samples that a signal may lose for a length that transforms fast …
LEAST_LOST = 1e-3
#: … which has these prime factors alone.
FACTORS = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31)


def fast_length(least: int) -> int:
    """Return the smallest 2^a 3^b 5^c at or above ``least``: a length with a fast FFT."""
    best = 2 ** max(0, (least - 1).bit_length())
    fives = 1
    while fives < best:
        threes = fives
        while threes < best:
            best = min(best, threes * 2 ** max(0, (-(-least // threes) - 1).bit_length()))
            threes *= 3
        fives *= 5
    return best


@functools.lru_cache(maxsize=64)
def fast_below(most: int, lost: float = LEAST_LOST) -> int:
    """Return the largest length up to ``most`` that transforms fast; ``most`` where that would lose a larger part than ``lost``.

    A length with a large prime factor takes fifteen times as long, and twice the memory.
    """
    lengths = most - np.arange(max(int(lost * most), 1))
    rest = lengths.copy()
    for prime in FACTORS:
        while np.any(divisible := rest % prime == 0):
            rest[divisible] //= prime
    smooth = lengths[rest == 1]
    return int(smooth[0]) if smooth.size else most

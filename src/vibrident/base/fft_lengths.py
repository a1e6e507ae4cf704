"""Lengths of signals with a fast Fourier transform."""

from __future__ import annotations

import functools

import numpy as np

#: Largest share of its samples that a signal may lose for a length with a fast transform …
MAX_LOST_SHARE = 1e-3
#: … which has these prime factors only.
FACTORS = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31)


def fast_length(least: int) -> int:
    """Return the smallest 2^a 3^b 5^c at or above ``least``: a length with a fast transform."""
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
def fast_below(most: int, lost: float = MAX_LOST_SHARE) -> int:
    """Return the length up to ``most``, of a share ``lost`` less at most, that transforms fastest.

    A transform takes as many steps for each of n values as its prime factors have in sum (Cooley &
    Tukey 1965). ``most`` itself where all lengths have large prime factors: these take fifteen
    times as long, and twice the memory.
    """
    lengths = most - np.arange(max(int(lost * most), 1))
    cofactor = lengths.copy()
    steps = np.zeros_like(lengths)
    for prime in FACTORS:
        while np.any(divisible := cofactor % prime == 0):
            cofactor[divisible] //= prime
            steps[divisible] += prime
    smooth = np.flatnonzero(cofactor == 1)
    return int(lengths[smooth[np.argmin((lengths * steps)[smooth])]]) if smooth.size else most

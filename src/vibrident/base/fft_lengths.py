"""Lengths of signals with a fast Fourier transform."""

from __future__ import annotations

import functools

import numpy as np

#: Largest share of its samples that a signal may lose for a length with a fast transform.
MAX_LOST_SHARE = 1e-3
#: Prime factors of a length with a fast transform.
FACTORS = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31)


@functools.lru_cache(maxsize=64)
def fast_length(min_length: int) -> int:
    """Return the smallest 2^a 3^b 5^c at or above a length: one with a fast transform."""
    shortest = 2 ** max(0, (min_length - 1).bit_length())
    fives = 1
    while fives < shortest:
        odd = fives
        while odd < shortest:
            doublings = max(0, (-(-min_length // odd) - 1).bit_length())
            shortest = min(shortest, odd * 2**doublings)
            odd *= 3
        fives *= 5
    return shortest


@functools.lru_cache(maxsize=64)
def fast_below(max_length: int, max_lost_share: float = MAX_LOST_SHARE) -> int:
    """Return the length with the fastest transform among those just below a length.

    A transform takes as many steps for each value as the sum of the length's prime factors (Cooley
    & Tukey 1965).

    Args:
        max_length: largest length; returned if all lengths have large prime factors, whose
            transforms take fifteen times as long, and twice the memory.
        max_lost_share: share of the largest length that may be lost.
    """
    lengths = max_length - np.arange(max(int(max_lost_share * max_length), 1))
    cofactor = lengths.copy()
    steps = np.zeros_like(lengths)
    for prime in FACTORS:
        while np.any(divisible := cofactor % prime == 0):
            cofactor[divisible] //= prime
            steps[divisible] += prime
    smooth = np.flatnonzero(cofactor == 1)
    return int(lengths[smooth[np.argmin((lengths * steps)[smooth])]]) if smooth.size else max_length

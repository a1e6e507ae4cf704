"""Tell whether a reference is held between samples, as by a digital-to-analogue converter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.records import FloatArray, Record

#: A step between treads exceeds this many standard deviations of the noise, which noise itself
#: exceeds with a chance of 1e-9.
MIN_STEP_SIGMA = 6.0
SIGMA_OF_MEDIAN = 1.4826  # standard deviation of normal numbers over the median of their size
MIN_LONE_POWER = 0.99  # part of the steps' power in steps whose neighbours are noise
MIN_EXPLAINED = 0.5  # part of the signal's power in the levels of its treads: most of it


def has_stairs(records: Sequence[Record]) -> bool:
    """Tell whether every screened, driven record's reference is in stairs, with noise or without.

    A commanded signal is held; a motion in stairs may be so, or was recorded with few bits.
    """
    references = [r.reference[r.reference_mask] for r in records if r.reference is not None]
    return bool(references) and all(map(is_stairs, references))


def is_stairs(drive: FloatArray) -> bool:
    """Tell whether a signal jumps from level to level, each of two samples or more.

    A motion with a few jumps does not: it moves between them, so that its mean levels explain
    little of its power.
    """
    size = np.abs(np.diff(drive))
    noise = SIGMA_OF_MEDIAN * float(np.median(size))
    steps = size > MIN_STEP_SIGMA * noise
    lone = steps.copy()
    lone[1:] &= ~steps[:-1]
    lone[:-1] &= ~steps[1:]
    power = float(np.sum(size[steps] ** 2))
    if power == 0.0 or float(np.sum(size[lone] ** 2)) < MIN_LONE_POWER * power:
        return False
    treads = np.concatenate([[0], 1 + np.flatnonzero(steps)])
    sums = np.add.reduceat(drive - np.mean(drive), treads)
    explained = float(np.sum(sums**2 / np.diff(treads, append=drive.size)))
    return explained >= MIN_EXPLAINED * drive.size * float(np.var(drive))

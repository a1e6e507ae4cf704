"""Outliers among several runs or mountings.

The test takes the studentised deletion residual: the distance of a run from the mean of its
mounting, over a standard deviation without that run. The furthest of all runs and parameters is
judged with Bonferroni's bound, which for one parameter of one mounting is the test of Grubbs
(1950).

F. E. Grubbs, Sample criteria for testing outlying observations, Ann. Math. Statist. 21 (1950)
27-58.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.data.records import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Outlier:
    """Run or mounting outside the scatter of the others.

    Attributes:
        runs: runs that belong to it: one, or those of a mounting; shape (runs,).
        parameter: index of the parameter that shows it most.
        probability: chance of a run or mounting as far from the others in any parameter.
    """

    runs: BoolArray
    parameter: int
    probability: float


def find_outlier(values: FloatArray, mountings: Sequence[str], noise: FloatArray) -> Outlier | None:
    """Return the run or mounting furthest from the others, or None if they are too few.

    Args:
        values: of each run, shape (runs, p).
        mountings: of each run.
        noise: smallest variance of a run, that of its noise, shape (p,).
    """
    names = list(dict.fromkeys(mountings))
    member = np.array([[mounting == name for mounting in mountings] for name in names])
    tests = [_test(values, member, np.eye(len(values), dtype=bool), noise)]
    if len(names) > 1:
        counts = member.sum(axis=1, keepdims=True)
        means = member @ values / counts
        tests.append(
            _test(means, np.ones((1, len(names)), dtype=bool), member, noise / counts.max())
        )
    possible = [test for test in tests if test is not None]
    if not possible:
        return None
    outlier = min(possible, key=lambda test: test.probability)
    return replace(outlier, probability=min(len(possible) * outlier.probability, 1.0))


def _test(
    values: FloatArray, member: BoolArray, runs: BoolArray, noise: FloatArray
) -> Outlier | None:
    """Test each row of values within its group.

    Args:
        values: shape (n, p).
        member: whether each row belongs to each group, shape (groups, n).
        runs: runs of each row, shape (n, runs).
        noise: smallest variance of a row, shape (p,).
    """
    counts = member.sum(axis=1)
    degrees = len(values) - len(member) - 1  # of a standard deviation without the row
    if degrees < 1:
        return None
    residual = values - member.T @ (member @ values / counts[:, None])
    # part of a row's variance that its residual has
    share = 1.0 - 1.0 / (member.T @ counts)[:, None]
    squares = np.divide(residual**2, share, out=np.zeros_like(residual), where=share > 0.0)
    variance = np.maximum((np.sum(residual**2, axis=0) - squares) / degrees, noise)
    at = np.unravel_index(
        int(np.argmax(squares / np.maximum(variance, np.finfo(float).tiny))), squares.shape
    )
    chance = squares.size * f_tail(
        1.0, degrees, float(squares[at] / max(float(variance[at]), np.finfo(float).tiny))
    )
    return Outlier(runs[at[0]], int(at[1]), chance)

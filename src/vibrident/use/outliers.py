"""Whether one of several runs, or one of several mountings, lies outside the scatter of the others.

By the studentised deletion residual: how far a run is from the mean of its mounting, over a
standard deviation that it has no part in. The furthest of all runs and parameters is judged with
Bonferroni's bound, which for one parameter of one mounting is the test of Grubbs (1950).

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
    """What lies outside the scatter of the others.

    Attributes:
        runs: that belong to it: one, or those of a mounting; shape (runs,).
        parameter: index of the parameter that shows it most.
        probability: chance of a run or mounting as far from the others in any parameter.
    """

    runs: BoolArray
    parameter: int
    probability: float


def furthest(values: FloatArray, mountings: Sequence[str], noise: FloatArray) -> Outlier | None:
    """Return the run or mounting furthest from the others; None where too few are there to tell.

    Args:
        values: of each run, shape (runs, p).
        mountings: of each run.
        noise: least variance of a run, that of its own noise, shape (p,).
    """
    names = list(dict.fromkeys(mountings))
    member = np.array([[each == name for each in mountings] for name in names])
    tests = [_test(values, member, np.eye(len(values), dtype=bool), noise)]
    if len(names) > 1:
        counts = member.sum(axis=1, keepdims=True)
        means = member @ values / counts
        tests.append(
            _test(means, np.ones((1, len(names)), dtype=bool), member, noise / counts.max())
        )
    known = [test for test in tests if test is not None]
    if not known:
        return None
    least = min(known, key=lambda test: test.probability)
    return replace(least, probability=min(len(known) * least.probability, 1.0))


def _test(
    values: FloatArray, member: BoolArray, runs: BoolArray, noise: FloatArray
) -> Outlier | None:
    """Test each row of values within its group.

    ``member``: of each group, shape (groups, n); ``runs``: of each row, shape (n, runs).
    """
    counts = member.sum(axis=1)
    degrees = len(values) - len(member) - 1  # of a standard deviation without the row
    if degrees < 1:
        return None
    residual = values - member.T @ (member @ values / counts[:, None])
    part = (
        1.0 - 1.0 / (member.T @ counts)[:, None]
    )  # of the variance of a row that its residual has
    squares = np.divide(residual**2, part, out=np.zeros_like(residual), where=part > 0.0)
    variance = np.maximum((np.sum(residual**2, axis=0) - squares) / degrees, noise)
    at = np.unravel_index(
        int(np.argmax(squares / np.maximum(variance, np.finfo(float).tiny))), squares.shape
    )
    chance = squares.size * f_tail(
        1.0, degrees, float(squares[at] / max(float(variance[at]), np.finfo(float).tiny))
    )
    return Outlier(runs[at[0]], int(at[1]), chance)

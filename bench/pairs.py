"""Ratios of times taken pairwise, A B A B …: whatever slows the machine slows both."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Ratio:
    """Times of A over times of B, by pair.

    Attributes:
        a: seconds of each A.
        b: seconds of each B beside it.
    """

    a: tuple[float, ...]
    b: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median of the pairs' ratios: the figure."""
        return float(np.median(np.array(self.a) / np.array(self.b)))

    @property
    def of_minima(self) -> float:
        """Least A over least B: what an idle machine would show."""
        return min(self.a) / min(self.b)

    def times(self, factor: float) -> Ratio:
        """Return the ratio with A taken ``factor`` times."""
        return Ratio(tuple(factor * a for a in self.a), self.b)

    @property
    def note(self) -> str:
        """Spread, in words."""
        ratios = np.array(self.a) / np.array(self.b)
        pairs = f"{len(ratios)} pairs" if len(ratios) > 1 else "1 pair"
        return (
            f"of minima {self.of_minima:.3g}; {pairs}, {np.min(ratios):.3g} to {np.max(ratios):.3g}"
        )


def seconds(job: Callable[[], object], repeats: int = 1) -> float:
    """Median time of a job."""
    durations = []
    for _ in range(repeats):
        begin = time.perf_counter()
        job()
        durations.append(time.perf_counter() - begin)
    return float(np.median(durations))


def pairwise(
    a: Callable[[], object],
    b: Callable[[], object],
    pairs: int,
    *,
    repeats_b: int = 1,
    warm_up: bool = True,
) -> Ratio:
    """Time A and B in turn.

    Args:
        a: a job.
        b: the job beside it.
        pairs: how often.
        repeats_b: B is the median of so many; for a job far shorter than A.
        warm_up: run both once before, untimed.
    """
    if warm_up:
        a(), b()
    gc.collect()
    times = [(seconds(a), seconds(b, repeats_b)) for _ in range(pairs)]
    return Ratio(tuple(pair[0] for pair in times), tuple(pair[1] for pair in times))

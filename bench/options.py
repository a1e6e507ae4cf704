"""What a run of the benchmarks can be told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Options:
    """Settings of a run.

    Attributes:
        runs: seeded runs of the statistics.
        jobs: processes for them.
        pairs: pairs of every ratio of times.
        quick: a short trial, whose figures are not published.
    """

    runs: int = 500
    jobs: int = 2
    pairs: int = 11
    quick: bool = False

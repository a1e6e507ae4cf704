"""All cases by name; each makes its trial from its own random numbers, whatever else is run."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from bench.adversary import (
    clean,
    clocks,
    damaged,
    decays,
    extremes,
    files,
    foreign,
    friction,
    held,
    lacking,
    quantities,
    several,
    tables,
    unlike,
    wild,
)
from bench.adversary.trial import Maker, Trial

GROUPS = {
    "clean": clean.cases,
    "defect": damaged.cases,
    "lacking": lacking.cases,
    "table": tables.cases,
    "decay": decays.cases,
    "extreme": extremes.cases,
    "file": files.cases,
    "several": several.cases,
    "foreign": foreign.cases,
    "quantities": quantities.quantities,
    "noises": quantities.noises,
    "long": quantities.long,
    "clocks": clocks.cases,
    "held": held.cases,
    "joined": held.joined,
    "wild": wild.cases,
    "unlike": unlike.cases,
    "friction": friction.friction,
    "steady": friction.steady,
}


@dataclass(frozen=True)
class Case:
    """Case of the study; ``runs`` of it differ by their seed."""

    name: str
    make: Maker

    def runs(self, requested: int) -> int:
        """Return the number of runs asked for."""
        return requested

    def trial(self, run: int = 0) -> Trial:
        """Return the trial of one run."""
        return self.make(np.random.default_rng([_shuffled(self), run]))


def _shuffled(case: Case) -> int:
    return zlib.crc32(case.name.encode())


#: In an order by chance, so that a study that was stopped early has seen some of everything.
CASES = tuple(
    sorted(
        (
            Case(f"{group}/{name}", make)
            for group, cases in GROUPS.items()
            for name, make in cases()
        ),
        key=_shuffled,
    )
)
BY_NAME = {case.name: case for case in CASES}
if len(BY_NAME) != len(CASES):
    raise ValueError("two cases have one name")

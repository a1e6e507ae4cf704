"""Orders to a worker: how to identify, within which limits, and where to write the outcome."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from vibrident.base.fields import Fields
from vibrident.base.registry import installed
from vibrident.base.version import __version__
from vibrident.fit.registry import TAKING_PART

TIME_LIMIT_S = 300.0  # default time limit of one calibration, in seconds
_MIN_PROCESS_BYTES = 4_000_000_000
_MEMORY_SHARE = 0.8


def plug_ins() -> tuple[str, ...]:
    """Return the installed packages, with versions, that take part in an identification."""
    points = (point for kind in TAKING_PART for point in installed().get(kind.group, ()))
    return tuple(
        sorted({f"{point.dist.name} {point.dist.version}" for point in points if point.dist})
    )


@dataclass(frozen=True)
class Orders:
    """Orders for all calibrations of a run."""

    folder: str  # absolute path for results and parts
    model: str | None = None  # of all calibrations; None for the one that each calibration states
    estimator: str = "auto"  # a name, or ``auto``
    time_limit_s: float = TIME_LIMIT_S  # longest time of one calibration
    # largest memory of one process; None: a share of the machine's, see ``memory_limit``
    memory_limit_bytes: int | None = None
    results: bool = True  # whether whole results are written
    version: str = __version__  # of this package; a remote worker must have the same
    plug_ins: Sequence[str] = field(default_factory=plug_ins)  # packages that may change an outcome
    run: str = ""  # name of this run; it distinguishes its processes from those of another run

    @property
    def settings(self) -> Fields:
        """Return the settings that change the numbers of an outcome."""
        settings = {"model": self.model, "estimator": self.estimator, "uncertainty": "auto"}
        return {**settings, "version": self.version, "plug_ins": list(self.plug_ins)}

    @property
    def parts_folder(self) -> Path:
        """Return the folder for rows."""
        return Path(self.folder) / "parts"

    @property
    def results_folder(self) -> Path:
        """Return the folder for whole results."""
        return Path(self.folder) / "results"


def memory_limit(orders: Orders) -> int | None:
    """Return the largest memory of a process that identifies, in bytes.

    It is None if the machine's memory is not known. Unless it is stated, it is each processor's
    share of four fifths of the memory, but at least 4 GB, because two large calibrations rarely run
    together; and never more than the four fifths.
    """
    if orders.memory_limit_bytes is not None:
        return orders.memory_limit_bytes
    total = _machine_bytes()
    if total is None:
        return None
    return int(
        min(
            _MEMORY_SHARE * total,
            max(_MIN_PROCESS_BYTES, _MEMORY_SHARE * total / (os.cpu_count() or 1)),
        )
    )


def _machine_bytes() -> int | None:
    """Return the memory of this machine, or of the container that this process is in."""
    limits = []
    with suppress(AttributeError, ValueError, OSError):  # not on Windows
        limits.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with suppress(OSError, ValueError):  # "max" is no number
        limits.append(int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii")))
    return min(limits, default=None)

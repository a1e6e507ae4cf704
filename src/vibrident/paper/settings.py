"""The extent of a reproduction, and its progress."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from vibrident.fit.optimise import Progress, silent
from vibrident.paper.training import Schedule


@dataclass(frozen=True)
class Settings:
    """What is run. The defaults run everything; ``quick()`` is a trial whose networks are not trained to the end."""

    seed: int = 20251111  # of everything random
    rate_hz: float = 51200.0  # sampling rate of sections 4 and 5; the paper does not state its own
    samples: int = 16000  # of every record
    schedule: Schedule = field(default_factory=Schedule)  # of everything trained by Adam
    # of the study of sampling rates, Euler's among them
    discretisations: tuple[str, ...] = ("euler", "zoh", "foh", "tustin", "bandlimited")
    # of the study of sampling rates
    rates_hz: tuple[float, ...] = (
        12800.0,
        25600.0,
        51200.0,
        102400.0,
        204800.0,
        409600.0,
        1024000.0,
    )
    # Of response noise in the study of noise, as fractions of each record's rms; 0.01 must be among
    # them.
    levels: tuple[float, ...] = (1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
    draws: int = 12  # realisations at each level
    full_range: bool = False  # also 41 records from 0.1 to 1000 Hz
    data: Path | None = None  # folder of real calibrations; None leaves the measured experiment out
    residual: bool = True  # whether the learned residual is shown
    jobs: int = 1  # processes for the networks without physics
    trial: bool = False  # True for a trial, whose figures are not final


def quick(seed: int, data: Path | None = None, *, full_range: bool = False) -> Settings:
    """Return a run of less than two minutes through everything."""
    return Settings(
        seed=seed,
        rate_hz=25600.0,
        samples=6000,
        schedule=Schedule(patience=10, most_epochs=15),
        rates_hz=(12800.0, 51200.0),
        levels=(1e-3, 1e-2),
        draws=3,
        full_range=full_range,
        data=data,
        trial=True,
    )


#: Called with the name of a stage; gives a context whose value shows its progress.
Stages = Callable[[str], contextlib.AbstractContextManager[Progress]]


@contextlib.contextmanager
def silently(what: str) -> Iterator[Progress]:
    """Stages that show nothing."""
    yield silent

"""Settings of a reproduction, and its progress."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from vibrident.fit.optimise import Progress, silent
from vibrident.paper.training import Schedule


@dataclass(frozen=True)
class ReproductionSettings:
    """Settings of a run. The defaults run everything.

    ``quick()`` is a trial whose networks are not trained to the end.

    Attributes:
        seed: of everything random.
        rate_hz: sampling rate of sections 4 and 5; the paper does not state its own.
        samples: of every record.
        schedule: of everything trained by Adam.
        discretisations: of the study of sampling rates, Euler's among them.
        rates_hz: of the study of sampling rates.
        levels: of response noise in the study of noise, as fractions of each record's rms; 0.01
            must be among them.
        draws: realisations at each level.
        full_range: also 41 records from 0.1 to 1000 Hz.
        data: folder of real calibrations; None leaves the measured experiment out.
        residual: whether the learned residual is shown.
        jobs: processes for the networks without physics.
        trial: True for a trial, whose figures are not final.
    """

    seed: int = 20251111
    rate_hz: float = 51200.0
    samples: int = 16000
    schedule: Schedule = field(default_factory=Schedule)
    discretisations: tuple[str, ...] = ("euler", "zoh", "foh", "tustin", "bandlimited")
    rates_hz: tuple[float, ...] = (
        12800.0,
        25600.0,
        51200.0,
        102400.0,
        204800.0,
        409600.0,
        1024000.0,
    )
    levels: tuple[float, ...] = (1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
    draws: int = 12
    full_range: bool = False
    data: Path | None = None
    residual: bool = True
    jobs: int = 1
    trial: bool = False


def quick(seed: int, data: Path | None = None, *, full_range: bool = False) -> ReproductionSettings:
    """Return a run of less than two minutes through everything."""
    return ReproductionSettings(
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
def silently(stage: str) -> Iterator[Progress]:
    """Show nothing of a stage."""
    yield silent

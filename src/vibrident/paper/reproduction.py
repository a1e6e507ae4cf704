"""Reproduce everything that the paper shows, from end to end."""

from __future__ import annotations

import platform
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from typing import Any

from vibrident.base.process import Process
from vibrident.base.version import __version__
from vibrident.paper.black_box import Kind
from vibrident.paper.experiment import interferometer, seismometer
from vibrident.paper.methods import Judge, MethodResult, recurrent
from vibrident.paper.sections import PaperSection, experiment, full_range, simulated, simulation
from vibrident.paper.settings import ReproductionSettings, Stages, silently
from vibrident.paper.studies import (
    NoiseStudy,
    RatePoint,
    Residual,
    error_by_noise,
    error_by_rate,
    learned_residuals,
)

KINDS: tuple[Kind, ...] = ("gru", "lstm")


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The numbers of a run.

    Attributes:
        settings: what was run.
        simulation: section 4.
        interferometer: section 5 on simulated data.
        seismometer: section 5 on measured data; None if unavailable.
        full_range: section 4 from 0.1 Hz; None unless asked for.
        rates: the study of sampling rates.
        noise: the study of noise.
        residuals: the learned residual on sensors of known truth; empty if left out.
        seconds: of the whole.
    """

    settings: ReproductionSettings
    simulation: PaperSection
    interferometer: PaperSection
    seismometer: PaperSection | None
    full_range: PaperSection | None
    rates: tuple[RatePoint, ...]
    noise: NoiseStudy
    residuals: tuple[Residual, ...]
    seconds: float = field(compare=False)

    @property
    def sections(self) -> tuple[PaperSection, ...]:
        """Return all sections that were run, section 4 first."""
        sections = (self.simulation, self.full_range, self.interferometer, self.seismometer)
        return tuple(section for section in sections if section is not None)

    def document(self) -> dict[str, Any]:
        """Return all numbers as plain values; times and versions stand apart, under ``run``."""
        return {
            "seed": self.settings.seed,
            "trial": self.settings.trial,
            "sections": [_section_document(section) for section in self.sections],
            "rates": [asdict(p) for p in self.rates],
            "noise": [
                {
                    "method": p.method,
                    "level": p.level,
                    "rms_error": dict(p.rms_error),
                    "bound": self.noise.bound.deviations(p.level),
                    "mean_percent": p.mean_percent,
                    "largest_percent": p.largest_percent,
                }
                for p in self.noise.points
            ],
            "learned_residual": [asdict(residual) for residual in self.residuals],
            "run": {
                "vibrident": __version__,
                "python": platform.python_version(),
                "seconds": self.seconds,
                "method_seconds": {
                    s.title: {row.name: row.seconds for row in s.rows} for s in self.sections
                },
            },
        }


def reproduce(settings: ReproductionSettings, stages: Stages = silently) -> Reproduction:
    """Run every experiment of the paper.

    Raises:
        InputError: the real data cannot be read.
    """
    begin = time.perf_counter()
    with stages("Making the data"):
        first = simulated(settings)
        laser = interferometer(
            seed=settings.seed, rate_hz=settings.rate_hz, samples=settings.samples
        )
        measured = None if settings.data is None else seismometer(settings.data, seed=settings.seed)
    experiments = [laser] if measured is None else [laser, measured]
    judges = [
        Judge(data.recorded, data.published, settings.schedule, settings.seed)
        for data in experiments
    ]
    first_rows, *rows = _train_recurrent([first, *judges], settings, stages)
    section_4 = simulation(first, first_rows, stages)
    sections_5 = [
        experiment(data, judge, results, stages)
        for data, judge, results in zip(experiments, judges, rows, strict=True)
    ]
    full = full_range(settings, stages) if settings.full_range else None
    with stages("Error against sampling rate") as progress:
        rate_points = error_by_rate(
            settings.rates_hz, settings.discretisations, seed=settings.seed, progress=progress
        )
    with stages("Error against noise") as progress:
        noise = error_by_noise(
            first.recorded, settings.levels, settings.draws, seed=settings.seed, progress=progress
        )
    residuals: list[Residual] = []
    if settings.residual:
        with stages("Learning what the physics leaves") as progress:
            residuals = learned_residuals(seed=settings.seed, progress=progress)
    return Reproduction(
        settings,
        section_4,
        sections_5[0],
        sections_5[1] if len(sections_5) > 1 else None,
        full,
        tuple(rate_points),
        noise,
        tuple(residuals),
        time.perf_counter() - begin,
    )


def _train_recurrent(
    judges: Sequence[Judge], settings: ReproductionSettings, stages: Stages
) -> list[list[MethodResult]]:
    """Train GRU and LSTM for every set of data, in parallel if there are processes."""
    tasks = [(judge, kind) for judge in judges for kind in KINDS]
    train = recurrent if settings.jobs == 1 else _train_in_process
    results: list[MethodResult] = []
    title = f"Training {len(tasks)} networks without physics (GRU, LSTM)"
    with stages(title) as progress, ThreadPoolExecutor(settings.jobs) as threads:
        for result in threads.map(train, *zip(*tasks, strict=True)):
            results.append(result)
            mse = float("nan") if result.metrics is None else result.metrics.mse
            progress(len(results), len(tasks), mse)
    return [results[i : i + len(KINDS)] for i in range(0, len(results), len(KINDS))]


def _train_in_process(judge: Judge, kind: Kind) -> MethodResult:
    """Train a network without physics in another process."""
    with Process() as process:
        return process.call(recurrent, judge, kind)


def _section_document(section: PaperSection) -> dict[str, Any]:
    data = section.published
    return {
        "title": section.title,
        "simulated": section.simulated,
        "sha256": data.sha256,
        "test_records": [data.calibration.records[i].name for i in data.test],
        "outliers": data.outliers,
        "methods": [
            {k: v for k, v in asdict(row).items() if k != "seconds"} for row in section.rows
        ],
        "deviations_percent": {
            name: {"mean": d.mean, "largest": d.largest, "at_peak": d.at_peak}
            for name, d in section.deviations.items()
        },
    }

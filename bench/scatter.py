"""Statistics of calibrations that differ in noise alone, against bound and stated intervals."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed

from bench.figures import Figure, Options, Section, steps
from bench.truth import COLUMNS, PARAMETERS, RESPONSE_NOISE, SEED, SENSOR, paper_truth
from vibrident import identify
from vibrident.paper.bound import cramer_rao
from vibrident.physics.simulation import with_noise

ESTIMATORS = ("ipnn", "ml")
QUICK_RUNS = 16


@dataclass(frozen=True)
class Draw:
    """Outcome of a run: values (estimators, parameters), coverage, and numbers of warnings."""

    values: np.ndarray
    covered: np.ndarray
    warnings: tuple[int, ...]


def draw(run: int) -> Draw:
    """Identify the calibration with the noise of a run; importable by other processes."""
    seed = np.random.SeedSequence(SEED, spawn_key=(run,))
    calibration = with_noise(paper_truth()[0], response_noise=RESPONSE_NOISE, seed=seed)
    results = [identify(calibration, estimator=name) for name in ESTIMATORS]
    tables = [[result.parameters[name] for name in PARAMETERS] for result in results]
    truth = [SENSOR.parameters[name] for name in PARAMETERS]
    return Draw(
        np.array([[parameter.value for parameter in table] for table in tables]),
        np.array(
            [
                [
                    p.interval_95[0] <= t <= p.interval_95[1]
                    for p, t in zip(table, truth, strict=True)
                ]
                for table in tables
            ]
        ),
        tuple(len(result.warnings) for result in results),
    )


def measure(options: Options) -> Section:
    """Measure scatter over the bound, bias over the scatter, and the coverage of 95 % intervals."""
    runs = min(options.runs, QUICK_RUNS) if options.quick else options.runs
    truth, motions = paper_truth()
    bound = cramer_rao(SENSOR, truth.records, motions).deviations(RESPONSE_NOISE)
    draws = list(steps("statistics", _draws(runs, options.jobs), total=runs))
    figures = [
        figure
        for index, name in enumerate(ESTIMATORS)
        for figure in _figures(name, index, draws, bound)
    ]
    relative = ", ".join(f"{bound[name]:.2e}" for name in PARAMETERS)
    remarks = (
        f"{runs} runs of 21 × 16 000 samples at 51.2 kHz, 1 % white response noise. By chance "
        f"alone, one standard deviation: scatter ± {100 / np.sqrt(2 * (runs - 1)):.1f} %, bias ± "
        f"{1 / np.sqrt(runs):.3f} σ, coverage ± {100 * np.sqrt(0.95 * 0.05 / runs):.1f} %.",
        f"Bound, relative: {relative}; Fisher information from differences of the exact response, "
        "initial states and offsets unknown.",
    )
    return Section("statistics", f"Statistics: {COLUMNS}", tuple(figures), {"runs": runs}, remarks)


def _draws(runs: int, jobs: int) -> Iterator[Draw]:
    if jobs == 1:
        return map(draw, range(runs))
    # loky starts fresh interpreters; nothing is forked.
    parallel = Parallel(n_jobs=jobs, backend="loky", return_as="generator", pre_dispatch="2*n_jobs")
    return parallel(delayed(draw)(run) for run in range(runs))


def _figures(name: str, index: int, draws: list[Draw], bound: dict[str, float]) -> list[Figure]:
    values = np.array([draw.values[index] for draw in draws])
    covered = np.array([draw.covered[index] for draw in draws])
    truth = np.array([SENSOR.parameters[parameter] for parameter in PARAMETERS])
    scatter = np.std(values, axis=0, ddof=1)
    bias = np.mean(values, axis=0) - truth
    warned = float(np.mean([draw.warnings[index] > 0 for draw in draws]))
    labelled = functools.partial(zip, PARAMETERS, strict=True)
    limits = np.abs(truth) * [bound[parameter] for parameter in PARAMETERS]
    note = (
        ""
        if warned == 0.0
        else f"{100 * warned:.2g} % of the runs carry a warning; a clean calibration has none"
    )
    return [
        Figure(
            f"{name}: scatter / Cramér–Rao bound",
            dict(labelled((scatter / limits).tolist())),
            high=1.10,
        ),
        Figure(
            f"{name}: bias / scatter",
            dict(labelled((bias / scatter).tolist())),
            "sigma",
            high=0.15,
            absolute=True,
        ),
        Figure(
            f"{name}: coverage of 95 % intervals",
            dict(labelled(np.mean(covered, axis=0).tolist())),
            "percent",
            low=0.92,
            high=0.98,
            note=note,
        ),
    ]

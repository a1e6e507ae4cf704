"""Statistics against PyDynamic's ``fit_som``: many draws of one 21-point response."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from bench.against import ENVIRONMENTS, ask, measured_response, table_of
from bench.figures import Figure, Options, Section, steps
from bench.pairs import Ratio, seconds
from bench.speed import noisy
from bench.truth import COLUMNS, PARAMETERS, SENSOR, model
from vibrident import Calibration, identify
from vibrident.fit.estimators import MaximumLikelihood
from vibrident.fit.problem import Evidence

#: Most draws: fit_som takes a second or more for each.
MAX_DRAWS = 60
QUICK_DRAWS = 3  # draws of a quick run
MIN_SPEED_RATIO = 20.0
#: Its weights, and what the table calls them.
WEIGHTINGS = {"": "equal weights (its default)", "cov": "weighted"}
PAIRS = 3


def measure(options: Options) -> Section:
    """Scatter, stated uncertainties, coverage and time, both on the same draws."""
    title = f"PyDynamic fit_som, 10 000 Monte Carlo draws a fit; ours: ml of the table; {COLUMNS}"
    python = ENVIRONMENTS / "pydynamic" / "bin" / "python"
    if not python.exists():
        note = "left out: no environment; `make bench-peers` makes it"
        return Section("fit_som", title, (Figure("all", {}, note=note),))
    runs = QUICK_DRAWS if options.quick else min(options.runs, MAX_DRAWS)
    frequency, _, deviation = measured_response(noisy())
    true = np.asarray(model().frequency_response(SENSOR.parameters, frequency))
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((2, runs, len(frequency))) * deviation
    draws = true + noise[0] + 1j * noise[1]
    calibrations = [
        Calibration(table=table_of(frequency, draw, deviation), model=SENSOR.model)
        for draw in draws
    ]
    parts = np.concatenate([draws.real, draws.imag], axis=1)
    truth = np.array([SENSOR.parameters[name] for name in PARAMETERS])
    ours, covered = _ours(calibrations, truth)
    figures = [
        Figure("ml: scatter / stated u", _labelled(_scatter(ours[0]) / _mean(ours[1]))),
        Figure(
            "ml: coverage of 95 % intervals",
            _labelled(covered.mean(axis=0)),
            "percent",
            low=0.9,
            high=1.0,
        ),
    ]
    versions = {}
    for weighting, words in WEIGHTINGS.items():
        arrays = {"frequency_hz": frequency, "deviation": np.tile(deviation, 2), "uncertain": True}
        data = {**arrays, "weighting": weighting, "parts": parts[0], "repeats": 1}
        answer = ask(python, "pydynamic_peer.py", {**data, "draws": parts})
        theirs = (np.array(answer["values"]), np.array(answer["uncertainties"]))
        versions = answer["versions"]
        held = (np.abs(theirs[0] - truth) < 1.96 * theirs[1]).mean(axis=0)
        figures += [
            Figure(
                f"scatter: ml / fit_som, {words}",
                _labelled(_scatter(ours[0]) / _scatter(theirs[0])),
                high=1.0,
            ),
            Figure(
                f"stated u: fit_som, {words} / ml", _labelled(_mean(theirs[1]) / _mean(ours[1]))
            ),
            Figure(
                f"fit_som, {words}: scatter / stated u",
                _labelled(_scatter(theirs[0]) / _mean(theirs[1])),
            ),
            Figure(f"fit_som, {words}: coverage of value ± 1.96 u", _labelled(held), "percent"),
        ]
    figures += _times(calibrations[0], python, data)
    remarks = (
        f"{runs} draws around the true response with the 21 standard uncertainties that "
        "`identify` states of the benchmark's records; both get the same numbers. By chance "
        f"alone, one standard deviation: scatter ± {100 / np.sqrt(2 * (runs - 1)):.0f} %, "
        f"coverage ± {100 * np.sqrt(0.95 * 0.05 / runs):.1f} %; the ratio of the two scatters is "
        "closer, because the draws are the same.",
    )
    return Section("fit_som", title, tuple(figures), {"runs": runs, "versions": versions}, remarks)


def _ours(
    calibrations: list[Calibration], truth: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Return values and u, and whether the intervals hold the truth; each (runs, parameters)."""
    tables = []
    for calibration in steps("fit_som", calibrations):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tables.append([identify(calibration).parameters[name] for name in PARAMETERS])
    values = np.array([[p.value for p in table] for table in tables])
    stated = np.array([[p.standard_uncertainty for p in table] for table in tables])
    ends = np.array([[p.interval_95 for p in table] for table in tables])
    return (values, stated), (ends[..., 0] <= truth) & (truth <= ends[..., 1])


def _times(calibration: Calibration, python: Path, data: dict) -> list[Figure]:
    evidence = Evidence.gather(calibration, model())
    _ = evidence.first_look
    jobs = {
        "ml fit": lambda: MaximumLikelihood().fit(evidence),
        "identify, from the table to the result": lambda: identify(calibration),
    }
    theirs: list[float] = []
    seconds_of: dict[str, list[float]] = {name: [] for name in jobs}
    for job in jobs.values():
        job()  # warm
    for _ in range(PAIRS):
        theirs.append(ask(python, "pydynamic_peer.py", data)["seconds"])
        for name, job in jobs.items():
            seconds_of[name].append(seconds(job, 15))
    ratios = {name: Ratio(tuple(theirs), tuple(ours)) for name, ours in seconds_of.items()}
    return [
        Figure(
            f"time: fit_som / {name}", {"ratio": ratio.median}, low=MIN_SPEED_RATIO, note=ratio.note
        )
        for name, ratio in ratios.items()
    ]


def _scatter(values: np.ndarray) -> np.ndarray:
    return np.std(values, axis=0, ddof=1)


def _mean(uncertainties: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(uncertainties**2, axis=0))


def _labelled(values: np.ndarray) -> dict[str, float]:
    return dict(zip(PARAMETERS, np.asarray(values, dtype=float).tolist(), strict=True))

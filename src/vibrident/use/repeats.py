"""Type A evaluation of several runs, the sensor remounted between them or not (GUM 4.2).

Each run is identified by itself. With M mountings of n_m runs each, the estimate is the mean of the
means of the mountings, whose covariance is that of these means over M, with M − 1 degrees of
freedom; with one mounting it is the mean of the n runs, with n − 1, without remounting.
The two components are those of the one-way random model: repeatability, the variance within
mountings, and remounting, what the means vary beyond it. Systematic effects are common to all runs
and are added (type B); the degrees of freedom are those of Welch and Satterthwaite (GUM G.4.1). A
run or mounting outside the scatter of the others (probability below 10⁻³) is named by a warning,
and stays in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.errors import InputError
from vibrident.data.records import Calibration, FloatArray
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.document import budget_of, covered, document
from vibrident.fit.response.verdict import REJECTION
from vibrident.fit.uncertainty import correlation, curve, parameter_table
from vibrident.fit.uncertainty.budget import (
    DATA,
    BudgetRow,
    as_settings,
    effective_degrees_of_freedom,
)
from vibrident.fit.uncertainty.floor import with_floor
from vibrident.fit.uncertainty.parameters import coverage_factor, parameter_units, unit_fields
from vibrident.physics.naming import in_words
from vibrident.result import Finding, MeasuredCurve, Result, ResultWarning
from vibrident.use.outliers import Outlier, find_outlier

REPEATABILITY = "repeatability"
REMOUNTING = "remounting"
VALUE_DIGITS = 7  # of a mean with and without a run


def group_by_run(calibration: Calibration) -> dict[tuple[str, str], Calibration]:
    """Group the records by mounting and run; one group where no runs are stated.

    Raises:
        InputError: some records belong to a run and others to none.
    """
    keys = [(r.circumstances.mounting, r.circumstances.run) for r in calibration.records]
    groups = {
        key: tuple(r for r, k in zip(calibration.records, keys, strict=True) if k == key)
        for key in keys
    }
    lacking = [r.name for r, key in zip(calibration.records, keys, strict=True) if not any(key)]
    if len(groups) > 1 and lacking:
        raise partly_stated_error(
            calibration, lacking, "belong to a run, and others to none", "run or mounting", "run"
        )
    return {key: replace(calibration, records=records) for key, records in groups.items()}


def partly_stated_error(
    calibration: Calibration, lacking: Sequence[str], words: str, field: str, name: str
) -> InputError:
    """Return the error of a field that some records state and others do not.

    Args:
        calibration: of the records.
        lacking: names of the records without the field.
        words: what some records do, and others do not.
        field: name of the field in a calibration file.
        name: of the field in words.
    """
    return InputError(
        f"Some records {words}.",
        expected=f"{field} in every [[records]] entry, or in none",
        found=", ".join(lacking)[:80],
        where=f"{calibration.source or 'calibration in memory'}, [[records]]",
        remedy=f"state the {name} of these records too",
    )


def identify_runs(
    runs: dict[tuple[str, str], Calibration], fit: Callable[[Calibration], Fitted], scope: Any
) -> Result:
    """Return the result of several runs together.

    Args:
        runs: mounting and run to its calibration, two or more.
        fit: estimates and judges a calibration.
        scope: as ``uncertainty`` of ``identify``, of each run.

    Raises:
        InputError: a run cannot be identified.
    """
    fits = [fit(each) for each in runs.values()]
    results = [document(each, budget_of(each, scope)) for each in fits]
    mountings = [mounting for mounting, _ in runs]
    first = fits[0]
    coordinates = first.estimate.coordinates
    z = np.array(
        [coordinates.place(each.estimate.coordinates.values(each.estimate.z)) for each in fits]
    )
    mean, data_rows = _components(z, mountings)
    rows = [*data_rows, *(row for row in budget_of(first, scope) if row.kind != DATA)]
    combined = _combined(first, results, mean, rows)
    outlier = find_outlier(
        z, mountings, np.mean([np.diag(each.estimate.covariance) for each in fits], axis=0)
    )
    if outlier is not None and outlier.probability < REJECTION:
        combined = _with_finding(combined, _finding(outlier, first, z, list(runs)))
    measured = _measured(results, combined, mountings)
    sources = [f"{len(fits)} runs"]
    if len(set(mountings)) > 1:
        sources.append(f"{len(set(mountings))} mountings")
    settings = {
        **combined.settings,
        "uncertainty_covers": "; ".join([*sources, *covered(rows)]),
        "repeats": _repeats_settings(list(runs), results),
    }
    settings = _with_scatter(settings, measured, sources[-1])
    combined = replace(combined, measured=measured, settings=settings)
    return with_floor(combined, first.evidence.calibration.capabilities)


def _combined(
    first: Fitted, results: Sequence[Result], mean: FloatArray, rows: Sequence[BudgetRow]
) -> Result:
    """Return the first run's result with the mean of all runs, its covariance and their warnings.

    Args:
        first: run.
        results: of each run.
        mean: coordinates, shape (p,).
        rows: budget of the mean.
    """
    coordinates = first.estimate.coordinates
    calibration = first.evidence.calibration
    model = first.evidence.model
    base = results[0]
    covariance = np.sum([row.covariance for row in rows], axis=0)
    freedom = float(np.min(effective_degrees_of_freedom(_join_type_a_rows(rows))))
    doubtful = {
        name: "" for each in results for name, p in each.parameters.items() if not p.identifiable
    }
    response = base.response
    if base.has_gain:
        response = curve(coordinates, mean, covariance, calibration.quantity, response.frequency_hz)
    files = [file for each in results for file in each.provenance.get("files") or ()]
    warnings = [warning for each in results for warning in each.warnings]
    return replace(
        base,
        parameters=parameter_table(
            coordinates, mean, covariance, freedom, unit_fields(calibration), doubtful
        ),
        correlation=correlation(model, covariance),
        response=response,
        warnings=tuple(dict.fromkeys(warnings)),
        findings=tuple(finding for each in results for finding in each.findings),
        fit=replace(base.fit, adequate=all(each.fit.adequate for each in results)),
        provenance={**base.provenance, "files": files},
        signals=tuple(signal for each in results for signal in each.signals),
        settings={
            **base.settings,
            "coverage_factor": coverage_factor(freedom),
            "effective_degrees_of_freedom": freedom,
            "uncertainty_budget": as_settings(
                rows, model.parameter_names, coordinates.slopes(mean)
            ),
        },
    )


def _with_finding(result: Result, finding: Finding) -> Result:
    warning = ResultWarning(finding.code, finding.message)
    return replace(
        result,
        warnings=tuple(dict.fromkeys([*result.warnings, warning])),
        findings=(*result.findings, finding),
    )


def _repeats_settings(runs: Sequence[tuple[str, str]], results: Sequence[Result]) -> dict[str, Any]:
    """Return the numbers of runs and mountings, and the values of each run."""
    return {
        "runs": len(runs),
        "mountings": len({mounting for mounting, _ in runs}),
        "values": [
            {
                "mounting": mounting,
                "run": run,
                **{n: p.value for n, p in result.parameters.items() if not p.derived},
            }
            for (mounting, run), result in zip(runs, results, strict=True)
        ],
    }


def _finding(
    outlier: Outlier, first: Fitted, z: FloatArray, runs: Sequence[tuple[str, str]]
) -> Finding:
    """Return the finding of a run or mounting outside the scatter of the others.

    Its impact is the change of the mean by the outlier.
    """
    within = np.flatnonzero(outlier.runs)
    coordinates = first.estimate.coordinates
    mountings = [mounting for mounting, _ in runs]
    remaining = np.flatnonzero(~outlier.runs)
    mean, _ = _components(z, mountings)
    mean_without, _ = _components(z[remaining], [mountings[i] for i in remaining])
    mean_values = coordinates.values(mean)
    without = coordinates.values(mean_without)
    mounting, run = runs[within[0]]
    words = [
        f"mounting {mounting}" if mounting else "",
        f"run {run}" if len(within) == 1 and run else "",
    ]
    name = list(mean_values)[outlier.parameter]
    unit = parameter_units(first.evidence.model, first.evidence.calibration)[name]
    changed, original = (
        amount(values[name], unit, VALUE_DIGITS) for values in (without, mean_values)
    )
    text = (
        f"{' '.join(filter(None, words)).capitalize()} lies outside the scatter of the others by "
        f"its {in_words(name)}. Without it the mean would be {changed} in place of {original}."
    )
    impact = {key: value - without[key] for key, value in mean_values.items()}
    return Finding("regimes", None, None, outlier.probability, impact, text)


def _with_scatter(settings: dict[str, Any], measured: MeasuredCurve, name: str) -> dict[str, Any]:
    """Return the settings with the scatter of the runs as the noise of the points."""
    points = settings.get("point_budget")
    if not points or points["frequency_hz"] != measured.frequency_hz.tolist():
        return {key: value for key, value in settings.items() if key != "point_budget"}
    columns = {
        "magnitude": measured.magnitude_noise.tolist(),
        "phase_deg": measured.phase_deg_noise.tolist(),
    }
    scatter = {"source": f"scatter of {name}", "type": "A", **columns}
    return {**settings, "point_budget": {**points, "sources": [scatter, *points["sources"][1:]]}}


def _components(z: FloatArray, mountings: Sequence[str]) -> tuple[FloatArray, list[BudgetRow]]:
    """Return the mean of the runs, shape (p,), and the type A rows of the budget.

    ``z``: coordinates of each run, shape (runs, p).
    """
    groups = _groups(z, mountings)
    means = np.array([group.mean(axis=0) for group in groups])
    covariance = np.atleast_2d(np.cov(means.T)) / len(groups)
    freedom = len(z) - len(groups)
    if freedom == 0:
        source = REMOUNTING if len(set(mountings)) > 1 else REPEATABILITY
        return means.mean(axis=0), [_row(source, covariance, len(groups) - 1)]
    within = sum(
        np.atleast_2d((group - group.mean(axis=0)).T @ (group - group.mean(axis=0)))
        for group in groups
    )
    repeatability = (
        within / freedom * float(np.mean([1.0 / len(group) for group in groups])) / len(groups)
    )
    # part of repeatability in the variance of the mean
    share = np.clip(np.diag(repeatability) / np.maximum(np.diag(covariance), 1e-300), 0.0, 1.0)
    repeated, remounted = (
        covariance * np.outer(weights, weights)
        for weights in (np.sqrt(share), np.sqrt(1.0 - share))
    )
    mixed = covariance - repeated - remounted  # of the correlations, none on the diagonal
    rows = [
        _row(REPEATABILITY, repeated, freedom),
        _row(REMOUNTING, remounted + mixed, len(groups) - 1),
    ]
    return means.mean(axis=0), rows


def _groups(values: FloatArray, mountings: Sequence[str]) -> list[FloatArray]:
    """Return the rows of each mounting, or each row by itself where there is one mounting.

    ``values``: shape (runs, …).
    """
    names = list(dict.fromkeys(mountings))
    if len(names) == 1:
        return list(values[:, None])
    return [values[[mounting == name for mounting in mountings]] for name in names]


def _row(source: str, covariance: FloatArray, freedom: int) -> BudgetRow:
    return BudgetRow(source, DATA, None, "", float(freedom), covariance)


def _join_type_a_rows(rows: Sequence[BudgetRow]) -> list[BudgetRow]:
    """Return the budget with its type A rows as one.

    That row has the degrees of freedom of the means: the rows are parts of one sample variance.
    """
    data = [row for row in rows if row.kind == DATA]
    covariance = np.sum([row.covariance for row in data], axis=0)
    return [replace(data[-1], covariance=covariance), *(row for row in rows if row.kind != DATA)]


def _measured(results: Sequence[Result], mean: Result, mountings: Sequence[str]) -> MeasuredCurve:
    """Return the points as means over the runs, their noise as the runs' scatter.

    Where the points of the runs do not match, those of the first run are returned.
    """
    curves = [result.measured for result in results]
    f = curves[0].frequency_hz
    alike = all(
        len(c.frequency_hz) == len(f) and np.all(abs(c.frequency_hz / f - 1) <= 1e-3)
        for c in curves
    )
    if not alike or not len(f):
        return curves[0]
    magnitudes, phases = (
        np.array([getattr(c, name) for c in curves]) for name in ("magnitude", "phase_deg")
    )
    phases = phases[0] + (phases - phases[0] + 180.0) % 360.0 - 180.0
    size, size_noise = _mean_over(magnitudes, mountings)
    turn, turn_noise = _mean_over(phases, mountings)
    first = curves[0]
    columns = (
        (first.magnitude_uncertainty, first.magnitude_noise),
        (first.phase_deg_uncertainty, first.phase_deg_noise),
    )
    common = [
        np.sqrt(np.maximum(np.nan_to_num(u) ** 2 - np.nan_to_num(noise) ** 2, 0.0))
        for u, noise in columns
    ]
    model = mean.to_sensor().frequency_response(f, mean.quantity)  # type: ignore[arg-type]
    shift = (np.rad2deg(np.angle(model)) - turn + 180.0) % 360.0 - 180.0
    return replace(
        first,
        magnitude=size,
        phase_deg=turn,
        magnitude_noise=size_noise,
        phase_deg_noise=turn_noise,
        magnitude_uncertainty=np.hypot(size_noise, common[0]),
        phase_deg_uncertainty=np.hypot(turn_noise, common[1]),
        deviation_percent=100.0 * (np.abs(model) / size - 1.0),
        deviation_phase_deg=shift,
        deviation_uncertainty_percent=100.0 * size_noise / size,
        deviation_phase_uncertainty_deg=turn_noise,
    )


def _mean_over(values: FloatArray, mountings: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return the mean of the mountings' means and its standard uncertainty.

    ``values``: shape (runs, points).
    """
    means = np.array([group.mean(axis=0) for group in _groups(values, mountings)])
    return means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(len(means))

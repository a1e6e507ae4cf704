"""Evaluate several runs as type A (GUM 4.2); the sensor may be remounted between them.

Each run is identified by itself. With M mountings of n_m runs each, the estimate is the mean of the
means of the mountings. Its covariance is the one of these means over M, with M − 1 degrees of
freedom. With one mounting, the estimate is the mean of the n runs, with n − 1 degrees of freedom.

The one-way random model has two components: repeatability is the variance within mountings, and
remounting the variance of the means beyond it. Systematic effects are common to all runs and are
added (type B). The degrees of freedom are those of Welch and Satterthwaite (GUM G.4.1). A warning
names a run or mounting outside the scatter of the others (probability below 10⁻³); it stays in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, NamedNumbers
from vibrident.data.records import Calibration, FloatArray, Record
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
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in calibration.records:
        key = record.circumstances.mounting, record.circumstances.run
        groups.setdefault(key, []).append(record)
    if len(groups) > 1 and ("", "") in groups:
        names = [record.name for record in groups["", ""]]
        raise partly_stated_error(
            calibration, names, "belong to a run, and others to none", "run or mounting", "run"
        )
    return {key: replace(calibration, records=tuple(group)) for key, group in groups.items()}


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
    fits = [fit(calibration) for calibration in runs.values()]
    results = [document(fitted, budget_of(fitted, scope)) for fitted in fits]
    mountings = [mounting for mounting, _ in runs]
    first = fits[0]
    coordinates = first.estimate.coordinates
    z = np.array(
        [
            coordinates.place(fitted.estimate.coordinates.values(fitted.estimate.z))
            for fitted in fits
        ]
    )
    mean, data_rows = _components(z, mountings)
    rows = [*data_rows, *(row for row in budget_of(first, scope) if row.kind != DATA)]
    combined = _combine(first, results, mean, rows)
    variances = np.mean([np.diag(fitted.estimate.covariance) for fitted in fits], axis=0)
    outlier = find_outlier(z, mountings, variances)
    if outlier is not None and outlier.probability < REJECTION:
        finding = _outlier_finding(outlier, first, z, list(runs))
        combined = replace(
            combined,
            warnings=(*combined.warnings, ResultWarning(finding.code, finding.message)),
            findings=(*combined.findings, finding),
        )
    measured = _mean_curve(results, combined, mountings)
    sources = [f"{len(runs)} runs"]
    mounting_count = len(set(mountings))
    if mounting_count > 1:
        sources.append(f"{mounting_count} mountings")
    settings = {
        **combined.settings,
        "uncertainty_covers": "; ".join([*sources, *covered(rows)]),
        "repeats": {
            "runs": len(runs),
            "mountings": mounting_count,
            "values": [
                {"mounting": mounting, "run": run, **_estimated_values(result)}
                for (mounting, run), result in zip(runs, results, strict=True)
            ],
        },
    }
    settings = _with_scatter(settings, measured, sources[-1])
    combined = replace(combined, measured=measured, settings=settings)
    return with_floor(combined, first.evidence.calibration.capabilities)


def _combine(
    first: Fitted, results: Sequence[Result], mean: FloatArray, rows: Sequence[BudgetRow]
) -> Result:
    """Return the result of the mean of all runs, with the warnings and findings of each.

    Args:
        first: the fit of the first run, whose other entries the result has.
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
        name: ""
        for result in results
        for name, parameter in result.parameters.items()
        if not parameter.identifiable
    }
    response = base.response
    if base.has_gain:
        response = curve(coordinates, mean, covariance, calibration.quantity, response.frequency_hz)
    files = [file for result in results for file in result.provenance.get("files") or ()]
    warnings = [warning for result in results for warning in result.warnings]
    return replace(
        base,
        parameters=parameter_table(
            coordinates, mean, covariance, freedom, unit_fields(calibration), doubtful
        ),
        correlation=correlation(model, covariance),
        response=response,
        warnings=tuple(dict.fromkeys(warnings)),
        findings=tuple(finding for result in results for finding in result.findings),
        fit=replace(base.fit, adequate=all(result.fit.adequate for result in results)),
        provenance={**base.provenance, "files": files},
        signals=tuple(signal for result in results for signal in result.signals),
        settings={
            **base.settings,
            "coverage_factor": coverage_factor(freedom),
            "effective_degrees_of_freedom": freedom,
            "uncertainty_budget": as_settings(
                rows, model.parameter_names, coordinates.slopes(mean)
            ),
        },
    )


def _estimated_values(result: Result) -> NamedNumbers:
    return {name: p.value for name, p in result.parameters.items() if not p.derived}


def _outlier_finding(
    outlier: Outlier, first: Fitted, z: FloatArray, runs: Sequence[tuple[str, str]]
) -> Finding:
    """Return the finding of a run or mounting outside the scatter of the others.

    Its impact is the change of the mean by the outlier.
    """
    coordinates = first.estimate.coordinates
    mountings = [mounting for mounting, _ in runs]
    remaining = np.flatnonzero(~outlier.runs)
    mean, _ = _components(z, mountings)
    mean_of_others, _ = _components(z[remaining], [mountings[i] for i in remaining])
    values = coordinates.values(mean)
    values_without = coordinates.values(mean_of_others)
    outlying = np.flatnonzero(outlier.runs)
    mounting, run = runs[outlying[0]]
    words = [f"mounting {mounting}"] if mounting else []
    if len(outlying) == 1 and run:
        words.append(f"run {run}")
    name = list(values)[outlier.parameter]
    unit = parameter_units(first.evidence.model, first.evidence.calibration)[name]
    text = (
        f"{' '.join(words).capitalize()} lies outside the scatter of the others by its "
        f"{in_words(name)}. Without it the mean would be "
        f"{amount(values_without[name], unit, VALUE_DIGITS)} in place of "
        f"{amount(values[name], unit, VALUE_DIGITS)}."
    )
    impact = {key: value - values_without[key] for key, value in values.items()}
    return Finding("regimes", None, None, outlier.probability, impact, text)


def _with_scatter(settings: Fields, measured: MeasuredCurve, name: str) -> Fields:
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
    groups = _group_by_mounting(z, mountings)
    means = np.array([group.mean(axis=0) for group in groups])
    covariance = np.atleast_2d(np.cov(means.T)) / len(groups)
    freedom = len(z) - len(groups)
    if freedom == 0:
        source = REMOUNTING if len(set(mountings)) > 1 else REPEATABILITY
        return means.mean(axis=0), [_data_row(source, covariance, len(groups) - 1)]
    deviations = [group - group.mean(axis=0) for group in groups]
    within = sum(np.atleast_2d(deviation.T @ deviation) for deviation in deviations)
    repeatability = (
        within / freedom * float(np.mean([1.0 / len(group) for group in groups])) / len(groups)
    )
    # repeatability's share of the variance of the mean
    share = np.clip(np.diag(repeatability) / np.maximum(np.diag(covariance), 1e-300), 0.0, 1.0)
    repeated, remounted = (
        covariance * np.outer(weights, weights)
        for weights in (np.sqrt(share), np.sqrt(1.0 - share))
    )
    mixed = covariance - repeated - remounted  # of the correlations, zero on the diagonal
    rows = [
        _data_row(REPEATABILITY, repeated, freedom),
        _data_row(REMOUNTING, remounted + mixed, len(groups) - 1),
    ]
    return means.mean(axis=0), rows


def _group_by_mounting(values: FloatArray, mountings: Sequence[str]) -> list[FloatArray]:
    """Return the rows of each mounting, or each row by itself where there is one mounting.

    ``values``: shape (runs, …).
    """
    names = list(dict.fromkeys(mountings))
    if len(names) == 1:
        return list(values[:, None])
    return [values[[mounting == name for mounting in mountings]] for name in names]


def _data_row(source: str, covariance: FloatArray, freedom: int) -> BudgetRow:
    return BudgetRow(source, DATA, None, "", float(freedom), covariance)


def _join_type_a_rows(rows: Sequence[BudgetRow]) -> list[BudgetRow]:
    """Return the budget with its type A rows as one.

    That row has the degrees of freedom of the means: the rows are parts of one sample variance.
    """
    data = [row for row in rows if row.kind == DATA]
    covariance = np.sum([row.covariance for row in data], axis=0)
    return [replace(data[-1], covariance=covariance), *(row for row in rows if row.kind != DATA)]


def _mean_curve(results: Sequence[Result], mean: Result, mountings: Sequence[str]) -> MeasuredCurve:
    """Return the points as means over the runs, with the runs' scatter as their noise.

    Where the points of the runs do not match, those of the first run are returned.
    """
    curves = [result.measured for result in results]
    first = curves[0]
    f = first.frequency_hz
    is_common = all(
        len(c.frequency_hz) == len(f) and np.all(abs(c.frequency_hz / f - 1) <= 1e-3)
        for c in curves
    )
    if not is_common or not len(f):
        return first
    phases = np.array([c.phase_deg for c in curves])
    phases = phases[0] + (phases - phases[0] + 180.0) % 360.0 - 180.0
    magnitude, magnitude_noise = _mean_over(np.array([c.magnitude for c in curves]), mountings)
    phase, phase_noise = _mean_over(phases, mountings)
    magnitude_u = _replace_noise(
        first.magnitude_uncertainty, first.magnitude_noise, magnitude_noise
    )
    phase_u = _replace_noise(first.phase_deg_uncertainty, first.phase_deg_noise, phase_noise)
    model = mean.to_sensor().frequency_response(f, mean.quantity)  # type: ignore[arg-type]
    return replace(
        first,
        magnitude=magnitude,
        phase_deg=phase,
        magnitude_noise=magnitude_noise,
        phase_deg_noise=phase_noise,
        magnitude_uncertainty=magnitude_u,
        phase_deg_uncertainty=phase_u,
        deviation_percent=100.0 * (np.abs(model) / magnitude - 1.0),
        deviation_phase_deg=(np.rad2deg(np.angle(model)) - phase + 180.0) % 360.0 - 180.0,
        deviation_uncertainty_percent=100.0 * magnitude_noise / magnitude,
        deviation_phase_uncertainty_deg=phase_noise,
    )


def _replace_noise(u: FloatArray, noise: FloatArray, new_noise: FloatArray) -> FloatArray:
    """Return an uncertainty with another noise in place of its own; NaN stands for zero."""
    common = np.sqrt(np.maximum(np.nan_to_num(u) ** 2 - np.nan_to_num(noise) ** 2, 0.0))
    return np.hypot(new_noise, common)


def _mean_over(values: FloatArray, mountings: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return the mean of the mountings' means and its standard uncertainty.

    ``values``: shape (runs, points).
    """
    means = np.array([group.mean(axis=0) for group in _group_by_mounting(values, mountings)])
    return means.mean(axis=0), means.std(axis=0, ddof=1) / np.sqrt(len(means))

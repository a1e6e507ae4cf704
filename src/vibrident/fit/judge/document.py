"""What is stated of an estimate, and the document that states it: covariance, budget, warnings, and the result."""

from __future__ import annotations

import contextlib
import datetime
import functools
import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Literal

import numpy as np

from vibrident.base.version import __version__
from vibrident.data.records import Calibration, FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.adequacy import Judgement, fit_of_signals, fit_of_table
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.doubts import second_thoughts
from vibrident.fit.judge.effects import all_effects, covered, measured, seen, what_is_covered
from vibrident.fit.judge.examined import Examined
from vibrident.fit.judge.refits import PHASE_BY_SCATTER
from vibrident.fit.problem import Evidence
from vibrident.fit.uncertainty import correlation, curve, parameter_table, weakly_determined
from vibrident.fit.uncertainty.budget import DATA, BudgetRow, as_settings, effective_degrees_of_freedom, rows_of_effects
from vibrident.fit.uncertainty.curve import frequencies, with_resonances
from vibrident.fit.uncertainty.floor import with_floor
from vibrident.fit.uncertainty.parameters import coverage_factor, unit_fields
from vibrident.fit.uncertainty.point_budget import point_budget
from vibrident.physics.models import SensorModel
from vibrident.physics.naming import in_words
from vibrident.result import Curve, Finding, MeasuredCurve, Result, ResultWarning, Training

Uncertainty = Literal["auto", "noise", "inflated"]
#: Shown iterations of the optimiser in a result.
MOST_TRACE = 400


def own_rows(fitted: Fitted, uncertainty: Uncertainty) -> list[BudgetRow]:
    """The budget of a calibration by itself: its data, then each systematic effect."""
    covariance, freedom, scope = _scaled(fitted, uncertainty)
    rows = rows_of_effects(all_effects(fitted.evidence, fitted.judgement), fitted.linear)
    return [BudgetRow(scope, DATA, None, "", freedom, covariance), *rows]


def document(fitted: Fitted, rows: Sequence[BudgetRow], more: Sequence[ResultWarning] = ()) -> Result:
    """The result of a calibration whose uncertainty consists of these rows; ``more`` warnings follow its own."""
    stated = _stated(fitted, rows)
    warnings = [warning for told in fitted.told for warning in told.warnings]
    findings = [finding for told in fitted.told for finding in told.findings]
    stated = replace(stated, warnings=[*warnings, *stated.warnings, *more], findings=[*findings, *stated.findings])
    result = _result(fitted.evidence, fitted.estimate, fitted.judgement, stated)
    effects = all_effects(fitted.evidence, fitted.judgement)
    points = point_budget(result.measured, effects, fitted.linear)
    settings = {**result.settings, "estimator_choice": fitted.reason, **({"point_budget": points} if points else {})}
    return with_floor(replace(result, settings=settings), fitted.evidence.calibration.capabilities)


@dataclass(frozen=True, eq=False)
class _Stated:
    """The statements about an estimate: its covariance with the sources of it, and the warnings."""

    covariance: FloatArray
    degrees_of_freedom: float
    scope: str
    rows: list[BudgetRow]
    weak: dict[str, str]
    warnings: list[ResultWarning]
    findings: list[Finding]


def _stated(fitted: Fitted, rows: Sequence[BudgetRow]) -> _Stated:
    evidence, estimate, judgement = fitted.evidence, fitted.estimate, fitted.judgement
    data = [row for row in rows if row.kind == DATA]
    covariance = np.sum([row.covariance for row in data], axis=0)
    total = np.sum([row.covariance for row in rows], axis=0)
    weak, warnings = weakly_determined(estimate.coordinates, estimate.z, covariance)
    warnings += second_thoughts(evidence, estimate, judgement, covariance)
    examined = fitted.examined or Examined.of(evidence, estimate, judgement)
    told = examined.told(judgement, total)
    warnings += told.warnings
    warnings += _learned(estimate)
    freedom = float(np.min(effective_degrees_of_freedom(rows)))
    scope = "; ".join(dict.fromkeys(row.source for row in data))
    return _Stated(total, freedom, scope, list(rows), weak, warnings, list(told.findings))


def _result(evidence: Evidence, estimate: Estimate, judgement: Judgement, stated: _Stated) -> Result:
    calibration, model = evidence.calibration, evidence.model
    coordinates, z, freedom = estimate.coordinates, estimate.z, stated.degrees_of_freedom
    names = model.parameter_names
    table = parameter_table(coordinates, z, stated.covariance, freedom, unit_fields(calibration), stated.weak)
    reference_hz = calibration.certificate.get("reference_frequency_hz")
    found = Curve.none(), MeasuredCurve.none()
    if model.has_gain:
        band = frequencies(evidence.band_hz, judgement.adequacy.frequency_hz.tolist(), reference_hz)
        band = with_resonances(band, model.rational(coordinates.values(z)))
        response = curve(coordinates, z, stated.covariance, calibration.quantity, band)
        found = response, measured(evidence, estimate, judgement)
    return Result(
        model=model.name,
        estimator=estimate.estimator,
        settings={
            **estimate.settings,
            **estimate.findings.as_settings(names),
            "uncertainty_covers": "; ".join([stated.scope, *covered(stated.rows)]),
            **seen(judgement),
            **_optics(calibration),
            "coverage_factor": coverage_factor(freedom),
            "effective_degrees_of_freedom": freedom,
            "reference_standard_uncertainty": calibration.reference_standard_uncertainty,
            "uncertainty_budget": as_settings(stated.rows, names, coordinates.slopes(z)),
            "start": dict(zip(names, np.asarray(coordinates.start).tolist(), strict=True)),
        },
        provenance=_provenance(calibration, evidence),
        parameters=table,
        correlation=correlation(model, stated.covariance),
        fit=fit_of_table(evidence, estimate, judgement) if calibration.table else fit_of_signals(evidence, judgement),
        response=found[0],
        measured=found[1],
        warnings=_warnings(evidence, model, table, judgement, stated.warnings, stated.scope),
        sensor=dict(calibration.sensor),
        reference={"quantity": calibration.quantity, "unit": calibration.reference_unit} if model.has_gain else {},
        response_unit=calibration.response_unit,
        signals=judgement.signals,
        training=_training(estimate),
        weights=judgement.weights,
        certificate=dict(calibration.certificate),
        findings=tuple(stated.findings),
        uncertainty={"covers": what_is_covered(stated.rows, calibration.table)},
    )


def _scaled(fitted: Fitted, choice: Uncertainty) -> tuple[np.ndarray, float, str]:
    """Covariance of z, its degrees of freedom, and in words what it covers."""
    evidence, estimate, judgement = fitted.evidence, fitted.estimate, fitted.judgement
    adequacy, freedom = judgement.adequacy, estimate.degrees_of_freedom
    if judgement.scatter is not None:
        scatter = "the scatter of the points (no uncertainty was stated)"
        if adequacy.degrees_of_freedom <= 0:
            nothing = "nothing: no uncertainty is stated, and no point is left to judge the scatter by"
            return estimate.covariance * judgement.scatter**2, float("inf"), nothing
        return estimate.covariance * judgement.scatter**2, float(max(adequacy.degrees_of_freedom, 1)), scatter
    error = estimate.findings.model_error
    if error is not None:
        text = f"noise and a relative model error of {100 * error:.3g} %, as large as the deviations demand"
        return estimate.covariance, freedom, text
    unasked = choice == "auto" and bool(evidence.records) and not adequacy.adequate
    if (choice == "inflated" or unasked) and judgement.birge > 1.0:
        text = f"noise, scaled by the Birge ratio {judgement.birge:.3g}, as the deviations demand"
        return estimate.covariance * judgement.birge**2, float(max(adequacy.degrees_of_freedom, 1)), text
    if fitted.phase_by_scatter:
        return estimate.covariance, freedom, f"stated uncertainties; {PHASE_BY_SCATTER}"
    return estimate.covariance, freedom, "noise" if evidence.records else "stated uncertainties"


def _warnings(
    evidence: Evidence,
    model: SensorModel,
    table: dict[str, Any],
    judgement: Judgement,
    doubtful: list[ResultWarning],
    scope: str,
) -> tuple[ResultWarning, ...]:
    warnings = [ResultWarning(finding.code, finding.message) for finding in evidence.findings]
    adequacy = judgement.adequacy
    if not adequacy.adequate:
        covered = f" The parameters' uncertainties cover {scope}."
        more = "".join(f" {w.message}" for w in doubtful if w.code == "lack_of_fit")
        warnings.append(ResultWarning("lack_of_fit", judgement.lack_of_fit + covered + more))
        doubtful = [w for w in doubtful if w.code != "lack_of_fit"]
    warnings += doubtful
    # fewer equations than parameters tell no sign
    if model.has_gain and table[model.gain_name].value < 0 and adequacy.degrees_of_freedom > 0:
        optical = any(record.optical is not None for record in evidence.records)
        other = (
            "the interferometer's columns are exchanged, or its direction is wrong"
            if optical
            else "a channel is wired reversed"
        )
        text = f"The {in_words(model.gain_name)} is negative: the response moves against the reference (or {other})."
        warnings.append(ResultWarning("polarity", text))
    return tuple(warnings)


def _optics(calibration: Calibration) -> dict[str, Any]:
    """Quality of an interferometer's signals, by record."""
    found = {r.name: r.optical.as_settings() for r in calibration.records if r.optical is not None}
    return {"interferometer": found} if found else {}


def _learned(estimate: Estimate) -> list[ResultWarning]:
    """The part that a learned residual explains is not explained by the model."""
    learned = estimate.findings.learned
    if learned is None or not learned.kept:
        return []
    text = (
        f"The model alone does not explain the data: a learned residual carries {100 * learned.share:.2g} % of the "
        "response (settings, residual_network). Parameters and curve are the model's own."
    )
    return [ResultWarning("lack_of_fit", text)]


def _training(estimate: Estimate) -> Training:
    """The way from the grid to the optimum: start values from the response, then the estimator's own iterations."""
    trace, begin = estimate.trace, estimate.begin
    names = estimate.coordinates.model.parameter_names
    keep = distinct(np.linspace(0, len(trace.costs) - 1, min(len(trace.costs), MOST_TRACE)).astype(int))
    before = () if begin is None or trace.optimiser == "adam" else _shown(begin.costs, begin.equations, begin.path)
    path = [estimate.coordinates.values(trace.coordinates[i]) for i in keep]
    own = _shown([trace.costs[i] for i in keep], estimate.equations, path)
    return Training(
        optimiser=trace.optimiser,
        status=trace.status,
        iterations=len(before) + len(trace.costs),
        loss=tuple(cost for cost, _ in (*before, *own)),
        parameters={name: tuple(float(point[name]) for _, point in (*before, *own)) for name in names},
        weighting_changes=(len(before),) if before else (),
    )


def _shown(
    costs: Sequence[float], equations: float, path: Sequence[dict[str, float]]
) -> tuple[tuple[float, dict[str, float]], ...]:
    """Mean squared weighted residual and parameters at each iterate."""
    return tuple((float(cost) / equations, point) for cost, point in zip(costs, path, strict=True))


@functools.cache  # reading a library's metadata takes time
def _versions() -> dict[str, str]:
    """Of the libraries behind the numbers, as far as they are installed."""
    found = {}
    for name in ("jax", "jaxlib", "numpy", "scipy", "equinox"):
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def _provenance(calibration: Calibration, evidence: Evidence) -> dict[str, Any]:
    sources = [r.provenance for r in evidence.records or calibration.records]
    if calibration.table is not None:
        sources = [calibration.table.provenance]
    return {
        "vibrident": __version__,
        "python": platform.python_version(),
        "libraries": _versions(),
        "calibration_file": calibration.source,
        "files": [{"file": s.file, "sha256": s.sha256, "history": list(s.history)} for s in sources],
        "seed": None,
        "time": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }

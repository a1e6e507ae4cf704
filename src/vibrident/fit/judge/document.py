"""What is stated of an estimate, and the document that states it: covariance, budget, warnings, and the result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from vibrident.data.records import REFERENCE_UNITS, Calibration, FloatArray, ResponseTable
from vibrident.data.records.basis import distinct
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.doubts import second_thoughts
from vibrident.fit.judge.examined import told
from vibrident.fit.judge.measured import fit_of_signals, fit_of_table, measured_curve
from vibrident.fit.judge.provenance import provenance
from vibrident.fit.judge.refits import PHASE_BY_SCATTER
from vibrident.fit.problem import FrequencyProblem
from vibrident.fit.uncertainty import correlation, curve, parameter_table, weakly_determined
from vibrident.fit.uncertainty.budget import (
    DATA,
    BudgetRow,
    as_settings,
    covered_kinds,
    effective_degrees_of_freedom,
    point_budget,
    rows_of_effects,
)
from vibrident.fit.uncertainty.curve import frequencies, with_resonances
from vibrident.fit.uncertainty.floor import with_floor
from vibrident.fit.uncertainty.parameters import coverage_factor, unit_fields
from vibrident.fit.uncertainty.profile import Profile, needs_profile, profile_of, with_profile
from vibrident.physics.models import SensorModel
from vibrident.physics.naming import in_words
from vibrident.result import Curve, MeasuredCurve, Parameter, Result, ResultWarning, Training

Uncertainty = Literal["auto", "noise", "inflated"]


def own_rows(fitted: Fitted, uncertainty: Uncertainty) -> list[BudgetRow]:
    """The budget of a calibration by itself: its data, then each systematic effect."""
    covariance, freedom, scope = _scaled(fitted, uncertainty)
    return [
        BudgetRow(scope, DATA, None, "", freedom, covariance),
        *rows_of_effects(fitted.effects, fitted.linear),
    ]


def document(
    fitted: Fitted, rows: Sequence[BudgetRow], more: Sequence[ResultWarning] = ()
) -> Result:
    """The result of a calibration whose uncertainty consists of these rows; ``more`` warnings follow its own."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    calibration = evidence.calibration
    model = evidence.model
    coordinates = estimate.coordinates
    data = [row for row in rows if row.kind == DATA]
    by_data, total = (np.sum([row.covariance for row in some], axis=0) for some in (data, rows))
    freedom = float(np.min(effective_degrees_of_freedom(rows)))
    scope = "; ".join(dict.fromkeys(row.source for row in data))
    weak, doubts = weakly_determined(coordinates, estimate.z, by_data)
    departures = told(fitted, total)
    doubts += [*second_thoughts(fitted, by_data), *departures.warnings, *_learned(estimate)]
    every = (*fitted.told, departures)
    table = parameter_table(coordinates, estimate.z, total, freedom, unit_fields(calibration), weak)
    profile = _profile(fitted, by_data, coverage_factor(freedom))
    if profile is not None:
        table, widened = with_profile(
            table, profile, coordinates, total - by_data, coverage_factor(freedom)
        )
        doubts = [
            w
            for w in doubts
            if not any(f"determine the {in_words(name)}:" in w.message for name in widened)
        ]
        doubts += [ResultWarning("weakly_determined", text) for text in widened.values()]
    warnings = _warnings(
        fitted, table, [w for one in fitted.told for w in one.warnings] + doubts + list(more), scope
    )
    response, measured = _curves(fitted, total)
    points = point_budget(measured, fitted.effects, fitted.linear)
    result = Result(
        model=model.name,
        estimator=estimate.estimator,
        settings={
            **estimate.settings,
            **estimate.findings.as_settings(model.parameter_names),
            "uncertainty_covers": "; ".join([scope, *covered(rows)]),
            **_seen(fitted),
            "coverage_factor": coverage_factor(freedom),
            "effective_degrees_of_freedom": freedom,
            "reference_standard_uncertainty": calibration.reference_standard_uncertainty,
            "uncertainty_budget": as_settings(
                rows, model.parameter_names, coordinates.slopes(estimate.z)
            ),
            "start": dict(
                zip(model.parameter_names, np.asarray(coordinates.start).tolist(), strict=True)
            ),
            "estimator_choice": fitted.reason,
            **({"point_budget": points} if points else {}),
        },
        provenance=provenance(fitted),
        parameters=table,
        correlation=correlation(model, total),
        fit=(fit_of_table if calibration.table else fit_of_signals)(fitted),
        response=response,
        measured=measured,
        warnings=warnings,
        sensor=dict(calibration.sensor),
        reference=_reference(calibration) if model.has_gain else {},
        sensitivity_per=_sensitivity_per(model, calibration) if model.has_gain else {},
        response_unit=calibration.response_unit,
        signals=judgement.signals,
        training=_training(estimate),
        weights=judgement.weights,
        certificate=dict(calibration.certificate),
        findings=tuple(finding for one in every for finding in one.findings),
        uncertainty={"covers": _kinds_covered(rows, calibration.table)},
    )
    return with_floor(result, calibration.capabilities)


def _reference(calibration: Calibration) -> dict[str, str]:
    return {"quantity": calibration.quantity, "unit": calibration.reference_unit}


def _sensitivity_per(model: SensorModel, calibration: Calibration) -> dict[str, str]:
    """Return the quantity that curve and points are per, with its unit; a drive has its own."""
    quantity = model.stated_quantity(calibration.quantity)
    drive = quantity == "drive"
    unit = calibration.reference_unit if drive else REFERENCE_UNITS[quantity]
    return {"quantity": quantity, "unit": unit}


def _profile(fitted: Fitted, by_data: FloatArray, coverage: float) -> Profile | None:
    """Return the profile likelihood of the response, where χ² is no parabola; None elsewhere."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    coordinates = estimate.coordinates
    adequacy = judgement.adequacy
    linear = (
        coordinates.model.is_linear
        and evidence.first_look is not None
        and len(adequacy.frequency_hz) > 0
    )
    if not linear or not adequacy.adequate or not needs_profile(coordinates, estimate.z, by_data):
        return None
    problem = evidence.first_look if evidence.calibration.table is not None else None
    if problem is None:
        problem = FrequencyProblem(evidence.model, evidence.quantity, adequacy.as_data)
    rise = (coverage * (judgement.scatter or 1.0)) ** 2
    return profile_of(problem, coordinates, estimate.z, by_data, rise)


def covered(rows: Sequence[BudgetRow]) -> list[str]:
    """The systematic effects among the rows, in words."""
    return list(dict.fromkeys(f"{row.source} ({row.kind})" for row in rows if row.kind != DATA))


def _kinds_covered(rows: Sequence[BudgetRow], table: ResponseTable | None) -> list[str]:
    """Which of ``noise``, ``gain`` and ``phase`` the uncertainties hold: scatter, and what was stated of the chain.

    The uncertainty that a table states of its points is all that its laboratory says of them, the chain's with it.
    """
    kinds = {row.kind for row in rows}
    if table is not None and table.magnitude_uncertainty is not None:
        kinds |= {"gain"} if table.phase_uncertainty_rad is None else {"gain", "phase"}
    return covered_kinds(kinds)


def _curves(fitted: Fitted, covariance: FloatArray) -> tuple[Curve, MeasuredCurve]:
    """The sensitivity over the band, and the points; empty for free decays, which have no gain."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    calibration = fitted.evidence.calibration
    if not evidence.model.has_gain:
        return Curve.none(), MeasuredCurve.none()
    reference_hz = calibration.certificate.get("reference_frequency_hz")
    band = frequencies(
        evidence.band_hz, fitted.judgement.adequacy.frequency_hz.tolist(), reference_hz
    )
    band = with_resonances(band, evidence.model.rational(fitted.values))
    return curve(
        estimate.coordinates, estimate.z, covariance, calibration.quantity, band
    ), measured_curve(fitted)


def _seen(fitted: Fitted) -> dict[str, Any]:
    """How much of each effect the data show, in its u; a model that explains all; the quality of optical signals."""
    judgement = fitted.judgement
    amounts = [
        {"source": e.source, "kind": e.kind, "amount_in_u": size} for e, size in judgement.effects
    ]
    records = fitted.evidence.calibration.records
    optical = {
        record.name: record.optical.as_settings()
        for record in records
        if record.optical is not None
    }
    found = {"systematic_effects_seen": amounts, "explained_by": judgement.explained_by}
    found |= {"interferometer": optical, "clock_offset": fitted.evidence.clock_offset}
    bands = {record.band_hz for record in fitted.evidence.records if record.band_hz is not None}
    found |= {"band_hz": [*bands.pop()] if len(bands) == 1 else []}
    return {name: value for name, value in found.items() if value}


def _scaled(fitted: Fitted, choice: Uncertainty) -> tuple[np.ndarray, float, str]:
    """Covariance of z, its degrees of freedom, and in words what it covers."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    adequacy = judgement.adequacy
    freedom = estimate.degrees_of_freedom
    if judgement.scatter is not None:
        scatter = "the scatter of the points (no uncertainty was stated)"
        if adequacy.degrees_of_freedom <= 0:
            nothing = (
                "nothing: no uncertainty is stated, and no point is left to judge the scatter by"
            )
            return estimate.covariance * judgement.scatter**2, float("inf"), nothing
        return (
            estimate.covariance * judgement.scatter**2,
            float(max(adequacy.degrees_of_freedom, 1)),
            scatter,
        )
    error = estimate.findings.model_error
    if error is not None:
        text = f"noise and a relative model error of {100 * error:.3g} %, as large as the deviations demand"
        return estimate.covariance, freedom, text
    unasked = choice == "auto" and bool(evidence.records) and not adequacy.adequate
    if (choice == "inflated" or unasked) and judgement.birge > 1.0:
        text = f"noise, scaled by the Birge ratio {judgement.birge:.3g}, as the deviations demand"
        return (
            estimate.covariance * judgement.birge**2,
            float(max(adequacy.degrees_of_freedom, 1)),
            text,
        )
    if fitted.phase_by_scatter:
        return estimate.covariance, freedom, f"stated uncertainties; {PHASE_BY_SCATTER}"
    return estimate.covariance, freedom, "noise" if evidence.records else "stated uncertainties"


def _warnings(
    fitted: Fitted, table: dict[str, Parameter], doubts: list[ResultWarning], scope: str
) -> tuple[ResultWarning, ...]:
    """Of the data, of the lack of fit (one for all that is said of it), of what is doubted, and of the sign."""
    evidence = fitted.evidence
    adequacy = fitted.judgement.adequacy
    model = fitted.evidence.model
    warnings = [ResultWarning(finding.code, finding.message) for finding in evidence.findings]
    if not adequacy.adequate:
        more = "".join(f" {w.message}" for w in doubts if w.code == "lack_of_fit")
        text = f"{fitted.judgement.lack_of_fit} The parameters' uncertainties cover {scope}.{more}"
        warnings.append(ResultWarning("lack_of_fit", text))
        doubts = [w for w in doubts if w.code != "lack_of_fit"]
    warnings += doubts
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
    trace = estimate.trace
    begin = estimate.begin
    names = estimate.coordinates.model.parameter_names
    keep = distinct(np.linspace(0, len(trace.costs) - 1, min(len(trace.costs), 400)).astype(int))
    before = (
        ()
        if begin is None or trace.optimiser == "adam"
        else _shown(begin.costs, begin.equations, begin.path)
    )
    path = [estimate.coordinates.values(trace.coordinates[i]) for i in keep]
    own = _shown([trace.costs[i] for i in keep], estimate.equations, path)
    return Training(
        optimiser=trace.optimiser,
        status=trace.status,
        iterations=len(before) + len(trace.costs),
        loss=tuple(cost for cost, _ in (*before, *own)),
        parameters={
            name: tuple(float(point[name]) for _, point in (*before, *own)) for name in names
        },
        weighting_changes=tuple(
            len(before) + int(np.searchsorted(keep, change))
            for change in ((0, *trace.changes) if before else trace.changes)
        ),
    )


def _shown(
    costs: Sequence[float], equations: float, path: Sequence[dict[str, float]]
) -> tuple[tuple[float, dict[str, float]], ...]:
    """Mean squared weighted residual and parameters at each iterate."""
    return tuple((float(cost) / equations, point) for cost, point in zip(costs, path, strict=True))

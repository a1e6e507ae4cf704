"""The result of an estimate: covariance, budget and warnings, put together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from vibrident.data.records import (
    REFERENCE_UNITS,
    Calibration,
    FloatArray,
    ResponseTable,
    is_motion,
)
from vibrident.data.records.basis import distinct
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.departure_report import report_departures
from vibrident.fit.judge.fit_warnings import warnings_of_fit
from vibrident.fit.judge.measured import fit_of_signals, fit_of_table, measured_curve
from vibrident.fit.judge.provenance import provenance
from vibrident.fit.judge.refits import PHASE_BY_SCATTER
from vibrident.fit.problem import Evidence, FrequencyProblem
from vibrident.fit.response.deconvolution import LOWEST_HZ
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
from vibrident.fit.uncertainty.profile import (
    Profile,
    needs_profile,
    points_suffice,
    profile_of,
    with_profile,
)
from vibrident.physics.models import SensorModel
from vibrident.physics.naming import in_words
from vibrident.result import Curve, MeasuredCurve, Parameter, Result, ResultWarning, Training

Uncertainty = Literal["auto", "noise", "inflated"]


def budget_of(fitted: Fitted, uncertainty: Uncertainty) -> list[BudgetRow]:
    """Return the budget of a calibration by itself: its data, then each systematic effect."""
    covariance, freedom, scope = _scaled_covariance(fitted, uncertainty)
    return [
        BudgetRow(scope, DATA, None, "", freedom, covariance),
        *rows_of_effects(fitted.effects, fitted.linear),
    ]


def document(
    fitted: Fitted, rows: Sequence[BudgetRow], further_warnings: Sequence[ResultWarning] = ()
) -> Result:
    """Return the result of a calibration whose uncertainty consists of these rows.

    ``further_warnings``: follow its own.
    """
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    calibration = evidence.calibration
    model = evidence.model
    coordinates = estimate.coordinates
    data = [row for row in rows if row.kind == DATA]
    by_data, total = (
        np.sum([row.covariance for row in selected], axis=0) for selected in (data, rows)
    )
    freedom = float(np.min(effective_degrees_of_freedom(rows)))
    scope = "; ".join(dict.fromkeys(row.source for row in data))
    weak, doubts = weakly_determined(coordinates, estimate.z, by_data)
    report = report_departures(fitted, total)
    doubts += [*warnings_of_fit(fitted, by_data), *report.warnings, *_warn_of_learned(estimate)]
    reports = (*fitted.reports, report)
    table = parameter_table(coordinates, estimate.z, total, freedom, unit_fields(calibration), weak)
    # Of a joint fit the data of one calibration do not tell how far χ² rises.
    profile = _profile(fitted, by_data, coverage_factor(freedom)) if len(data) == 1 else None
    if profile is not None:
        table, widened = with_profile(
            table, profile, coordinates, total - by_data, coverage_factor(freedom)
        )
        doubts = _with_intervals(doubts, widened)
    warnings = _warnings(
        fitted,
        table,
        [warning for earlier in fitted.reports for warning in earlier.warnings]
        + doubts
        + list(further_warnings),
        scope,
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
            **_settings_of_data(fitted),
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
        findings=tuple(finding for earlier in reports for finding in earlier.findings),
        uncertainty={"covers": _kinds_covered(rows, calibration.table)},
    )
    return with_floor(result, calibration.capabilities)


def _with_intervals(
    doubts: Sequence[ResultWarning], widened: Mapping[str, str]
) -> list[ResultWarning]:
    """Return the doubts with the sentences on widened intervals in place of those they replace.

    ``widened``: sentence of each parameter with an interval of the profile, by name.
    """
    remaining = [
        warning
        for warning in doubts
        if not any(f"determine the {in_words(name)}:" in warning.message for name in widened)
    ]
    return remaining + [ResultWarning("weakly_determined", text) for text in widened.values()]


def _reference(calibration: Calibration) -> dict[str, str]:
    """Return quantity and unit of the reference."""
    return {"quantity": calibration.quantity, "unit": calibration.reference_unit}


def _sensitivity_per(model: SensorModel, calibration: Calibration) -> dict[str, str]:
    """Return the quantity that curve and points are per, with its unit; a drive has its own."""
    quantity = model.stated_quantity(calibration.quantity)
    unit = REFERENCE_UNITS[quantity] if is_motion(quantity) else calibration.reference_unit
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
    if evidence.calibration.table is not None:
        problem = evidence.first_look
        assert problem is not None
    else:
        problem = FrequencyProblem(evidence.model, evidence.quantity, adequacy.as_data)
        if estimate.in_noise and not points_suffice(problem, coordinates, estimate.z, by_data):
            problem = estimate.in_noise.likelihood()
    rise = (coverage * (judgement.scatter or 1.0)) ** 2
    return profile_of(problem, coordinates, estimate.z, by_data, rise)


def covered(rows: Sequence[BudgetRow]) -> list[str]:
    """Return the systematic effects among the rows, in words."""
    return list(dict.fromkeys(f"{row.source} ({row.kind})" for row in rows if row.kind != DATA))


def _kinds_covered(rows: Sequence[BudgetRow], table: ResponseTable | None) -> list[str]:
    """Return which of ``noise``, ``gain`` and ``phase`` the uncertainties hold.

    They hold scatter, and what was stated of the chain. The uncertainty that a table states of its
    points is all that its laboratory says of them, the chain's with it.
    """
    kinds = {row.kind for row in rows}
    if table is not None and table.magnitude_uncertainty is not None:
        kinds |= {"gain"} if table.phase_uncertainty_rad is None else {"gain", "phase"}
    return covered_kinds(kinds)


def _curves(fitted: Fitted, covariance: FloatArray) -> tuple[Curve, MeasuredCurve]:
    """Return the sensitivity over the band, and the points; empty for free decays.

    These have no gain.
    """
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


def _settings_of_data(fitted: Fitted) -> dict[str, Any]:
    """Return, for the settings, what the data show beside the parameters.

    It is how much of each effect they show, in its u, a model that explains all, and the quality of
    optical signals.
    """
    judgement = fitted.judgement
    amounts: list[dict[str, Any]] = [
        {"source": effect.source, "kind": effect.kind, "amount_in_u": size}
        for effect, size in judgement.effects
    ]
    for row, correction in zip(amounts, fitted.evidence.corrections, strict=False):
        row["uncertainty_in_u"] = correction.uncertainty  # of what the records are corrected for
    records = fitted.evidence.calibration.records
    optical = {
        record.name: record.optical.as_settings()
        for record in records
        if record.optical is not None
    }
    settings = {"systematic_effects_seen": amounts, "explained_by": judgement.explained_by}
    settings |= {"interferometer": optical, "clock_offset": fitted.evidence.clock_offset}
    settings |= {"known_responses": _known_responses(fitted.evidence)}
    bands = {record.band_hz for record in fitted.evidence.records if record.band_hz is not None}
    settings |= {"band_hz": [*bands.pop()] if len(bands) == 1 else []}
    return {name: value for name, value in settings.items() if value}


def _known_responses(evidence: Evidence) -> list[dict[str, Any]]:
    """Return what was taken out of each channel, and the remaining band."""
    bands = [record.band_hz for record in evidence.records if record.band_hz is not None]
    band_hz = [*evidence.band_hz]
    if bands:
        low = min(low for low, _ in bands)
        high = max(high for _, high in bands)
        band_hz = [low if low > LOWEST_HZ else band_hz[0], high]
    known = evidence.calibration.known_responses.items()
    return [
        {"channel": name, "source": response.source, "band_hz": band_hz} for name, response in known
    ]


def _scaled_covariance(fitted: Fitted, choice: Uncertainty) -> tuple[np.ndarray, float, str]:
    """Return the covariance of z, its degrees of freedom, and in words what it covers."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    adequacy = judgement.adequacy
    freedom = estimate.degrees_of_freedom
    if judgement.scatter is not None:
        scatter = "the scatter of the points (no uncertainty was stated)"
        if adequacy.degrees_of_freedom <= 0:
            no_scatter = (
                "nothing: no uncertainty is stated, and no point is left to judge the scatter by"
            )
            return estimate.covariance * judgement.scatter**2, float("inf"), no_scatter
        return (
            estimate.covariance * judgement.scatter**2,
            float(max(adequacy.degrees_of_freedom, 1)),
            scatter,
        )
    model_error = estimate.findings.model_error
    if model_error is not None:
        text = (
            f"noise and a relative model error of {100 * model_error:.3g} %, "
            "as large as the deviations demand"
        )
        return estimate.covariance, freedom, text
    inflated_by_default = choice == "auto" and bool(evidence.records) and not adequacy.adequate
    if (choice == "inflated" or inflated_by_default) and judgement.birge > 1.0:
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
    """Return the warnings of the data, of the lack of fit, of what is doubted, and of the sign.

    The lack of fit is one warning with all that is said of it.
    """
    evidence = fitted.evidence
    adequacy = fitted.judgement.adequacy
    model = fitted.evidence.model
    warnings = [ResultWarning(finding.code, finding.message) for finding in evidence.findings]
    if not adequacy.adequate:
        further = "".join(f" {doubt.message}" for doubt in doubts if doubt.code == "lack_of_fit")
        text = (
            f"{fitted.judgement.lack_of_fit} The parameters' uncertainties cover {scope}.{further}"
        )
        warnings.append(ResultWarning("lack_of_fit", text))
        doubts = [doubt for doubt in doubts if doubt.code != "lack_of_fit"]
    warnings += doubts
    # Fewer equations than parameters determine no sign.
    if model.has_gain and table[model.gain_name].value < 0 and adequacy.degrees_of_freedom > 0:
        optical = any(record.optical is not None for record in evidence.records)
        cause = (
            "the interferometer's columns are exchanged, or its direction is wrong"
            if optical
            else "a channel is wired reversed"
        )
        text = (
            f"The {in_words(model.gain_name)} is negative: "
            f"the response moves against the reference (or {cause})."
        )
        warnings.append(ResultWarning("polarity", text))
    return tuple(warnings)


def _warn_of_learned(estimate: Estimate) -> list[ResultWarning]:
    """Return the warning that a learned residual explains a part, if one is used."""
    learned = estimate.findings.learned
    if learned is None or not learned.accepted:
        return []
    text = (
        "The model alone does not explain the data: a learned residual carries "
        f"{100 * learned.share:.2g} % of the response (settings, residual_network). "
        "Parameters and curve are the model's own."
    )
    return [ResultWarning("lack_of_fit", text)]


def _training(estimate: Estimate) -> Training:
    """Return the way from the grid to the optimum: start values, then the estimator's steps."""
    trace = estimate.trace
    begin = estimate.begin
    names = estimate.coordinates.model.parameter_names
    indices = distinct(np.linspace(0, len(trace.costs) - 1, min(len(trace.costs), 400)).astype(int))
    of_start = (
        ()
        if begin is None or trace.optimiser == "adam"
        else _iterates(begin.costs, begin.equations, begin.path)
    )
    path = [estimate.coordinates.values(trace.coordinates[i]) for i in indices]
    of_estimator = _iterates([trace.costs[i] for i in indices], estimate.equations, path)
    return Training(
        optimiser=trace.optimiser,
        status=trace.status,
        iterations=len(of_start) + len(trace.costs),
        loss=tuple(cost for cost, _ in (*of_start, *of_estimator)),
        parameters={
            name: tuple(float(point[name]) for _, point in (*of_start, *of_estimator))
            for name in names
        },
        weighting_changes=tuple(
            len(of_start) + int(np.searchsorted(indices, change))
            for change in ((0, *trace.changes) if of_start else trace.changes)
        ),
    )


def _iterates(
    costs: Sequence[float], equations: float, path: Sequence[dict[str, float]]
) -> tuple[tuple[float, dict[str, float]], ...]:
    """Return the mean squared weighted residual and the parameters at each iterate."""
    return tuple((float(cost) / equations, point) for cost, point in zip(costs, path, strict=True))

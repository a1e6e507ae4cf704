"""The result of an estimate: covariance, budget and warnings, put together."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
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
from vibrident.fit.judge.measured import measured_curve, metrics, sums_of_signals, sums_of_table
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
    effects_of,
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
    coverage = coverage_factor(freedom)
    # The data of one calibration in a joint fit do not tell how far χ² of all rises.
    profile = _profile(fitted, by_data, coverage) if len(data) == 1 else None
    if profile is not None:
        table, widened = with_profile(table, profile, coordinates, total - by_data, coverage)
        doubts = _with_intervals(doubts, widened)
    of_departures = [warning for earlier in fitted.reports for warning in earlier.warnings]
    warnings = _warnings(fitted, table, [*of_departures, *doubts, *further_warnings], scope)
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
            "coverage_factor": coverage,
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
        fit=metrics((sums_of_table if calibration.table else sums_of_signals)(fitted), fitted),
        response=response,
        measured=measured,
        warnings=warnings,
        sensor=dict(calibration.sensor),
        reference={"quantity": calibration.quantity, "unit": calibration.reference_unit}
        if model.has_gain
        else {},
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
    """Return the doubts, with sentences on widened intervals in place of those that they replace.

    ``widened``: sentence of each parameter with an interval of the profile, by name.
    """
    remaining = [
        warning
        for warning in doubts
        if not any(f"determine the {in_words(name)}:" in warning.message for name in widened)
    ]
    return remaining + [ResultWarning("weakly_determined", text) for text in widened.values()]


def _sensitivity_per(model: SensorModel, calibration: Calibration) -> dict[str, str]:
    """Return quantity and unit that the curve and the points are per; a drive has its own unit."""
    quantity = model.stated_quantity(calibration.quantity)
    unit = REFERENCE_UNITS[quantity] if is_motion(quantity) else calibration.reference_unit
    return {"quantity": quantity, "unit": unit}


def _profile(fitted: Fitted, by_data: FloatArray, coverage: float) -> Profile | None:
    """Return the profile likelihood of the response, where χ² is no parabola; None elsewhere."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    coordinates = estimate.coordinates
    adequacy = fitted.judgement.adequacy
    if not coordinates.model.is_linear or not len(adequacy.frequency_hz):
        return None
    if not adequacy.adequate or not needs_profile(coordinates, estimate.z, by_data):
        return None
    problem = evidence.table_points
    if problem is None:
        problem = FrequencyProblem(evidence.model, evidence.quantity, adequacy.as_data)
        if estimate.in_noise and not points_suffice(problem, coordinates, estimate.z, by_data):
            problem = estimate.in_noise.likelihood()
    rise = (coverage * (fitted.judgement.scatter or 1.0)) ** 2
    return profile_of(problem, coordinates, estimate.z, by_data, rise)


def covered(rows: Sequence[BudgetRow]) -> list[str]:
    """Return the systematic effects among the rows, in words."""
    return list(dict.fromkeys(f"{row.source} ({row.kind})" for row in rows if row.kind != DATA))


def _kinds_covered(rows: Sequence[BudgetRow], table: ResponseTable | None) -> list[str]:
    """Return which of ``noise``, ``gain`` and ``phase`` the uncertainties hold.

    They hold the scatter of the data, and statements on the chain. The uncertainty that a table
    states of its points includes that of the chain.
    """
    kinds = {row.kind for row in rows}
    if table is not None and table.magnitude_uncertainty is not None:
        kinds |= {"gain"} if table.phase_uncertainty_rad is None else {"gain", "phase"}
    return covered_kinds(kinds)


def _curves(fitted: Fitted, covariance: FloatArray) -> tuple[Curve, MeasuredCurve]:
    """Return the sensitivity over the band, and the points; both empty for a model without gain."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    calibration = evidence.calibration
    if not evidence.model.has_gain:
        return Curve.none(), MeasuredCurve.none()
    reference_hz = calibration.certificate.get("reference_frequency_hz")
    measured_hz = fitted.judgement.adequacy.frequency_hz.tolist()
    grid_hz = with_resonances(
        frequencies(fitted.band_hz, measured_hz, reference_hz),
        evidence.model.rational(fitted.values),
    )
    return curve(
        estimate.coordinates, estimate.z, covariance, calibration.quantity, grid_hz
    ), measured_curve(fitted)


def _settings_of_data(fitted: Fitted) -> dict[str, Any]:
    """Return the settings that state what the data show beside the parameters.

    These are the amount of each systematic effect in its u, those that the data are corrected for,
    a model that explains all, the quality of optical signals, the clock's offset, known responses
    of the channels and their band.
    """
    evidence = fitted.evidence
    amounts = [
        {"source": effect.source, "kind": effect.kind, "amount_in_u": size}
        for effect, size in fitted.judgement.effects
    ]
    bands = {record.band_hz for record in evidence.records if record.band_hz is not None}
    settings = {
        "systematic_effects_seen": amounts,
        "corrected_for": _corrections(evidence),
        "explained_by": fitted.judgement.explained_by,
        "interferometer": {
            record.name: record.optical.as_settings()
            for record in evidence.calibration.records
            if record.optical is not None
        },
        "clock_offset": evidence.clock_offset,
        "known_responses": _known_responses(fitted, bands),
        "band_hz": [*next(iter(bands))] if len(bands) == 1 else [],
    }
    return {name: value for name, value in settings.items() if value}


def _corrections(evidence: Evidence) -> list[dict[str, Any]]:
    """Return the stated effects that the data are corrected for, and by how much."""
    stated = effects_of(evidence.calibration)
    return [
        {
            "source": effect.source,
            "kind": effect.kind,
            "amount": correction.amount * effect.standard_uncertainty,
            "standard_uncertainty": correction.uncertainty * effect.standard_uncertainty,
            "unit": effect.unit,
        }
        for effect, correction in zip(stated, evidence.corrections, strict=False)
        if correction.amount
    ]


def _known_responses(
    fitted: Fitted, bands_hz: Collection[tuple[float, float]]
) -> list[dict[str, Any]]:
    """Return the known response that was divided out of each channel, and the remaining band.

    ``bands_hz``: of the records that such a response limits.
    """
    band_hz = [*fitted.band_hz]
    if bands_hz:
        low = min(low for low, _ in bands_hz)
        band_hz = [low if low > LOWEST_HZ else band_hz[0], max(high for _, high in bands_hz)]
    return [
        {"channel": name, "source": response.source, "band_hz": band_hz}
        for name, response in fitted.evidence.calibration.known_responses.items()
    ]


def _scaled_covariance(fitted: Fitted, choice: Uncertainty) -> tuple[np.ndarray, float, str]:
    """Return the covariance of z, its degrees of freedom, and in words what it covers."""
    estimate = fitted.estimate
    judgement = fitted.judgement
    has_records = bool(fitted.evidence.records)
    points_freedom = float(judgement.adequacy.degrees_of_freedom)
    model_error = estimate.findings.model_error
    inflated = choice == "inflated" or (
        choice == "auto" and has_records and not judgement.adequacy.adequate
    )
    factor = 1.0
    freedom = estimate.degrees_of_freedom
    scope = "noise" if has_records else "stated uncertainties"
    if judgement.scatter is not None:
        factor = judgement.scatter
        freedom = points_freedom if points_freedom > 0.0 else float("inf")
        scope = (
            "the scatter of the points (no uncertainty was stated)"
            if points_freedom > 0.0
            else "nothing: no uncertainty is stated, and no point is left to judge the scatter by"
        )
    elif model_error is not None:
        scope = (
            f"noise and a relative model error of {100 * model_error:.3g} %, "
            "as large as the deviations demand"
        )
    elif inflated and judgement.birge > 1.0:
        factor = judgement.birge
        freedom = max(points_freedom, 1.0)
        scope = f"noise, scaled by the Birge ratio {factor:.3g}, as the deviations demand"
    elif fitted.phase_by_scatter:
        scope += f"; {PHASE_BY_SCATTER}"
    return estimate.covariance * factor**2, freedom, scope


def _warnings(
    fitted: Fitted, table: dict[str, Parameter], doubts: list[ResultWarning], scope: str
) -> tuple[ResultWarning, ...]:
    """Return the warnings of the data, of the lack of fit, of doubts, and of a negative gain.

    All doubts that concern the lack of fit are joined in one warning.
    """
    evidence = fitted.evidence
    adequacy = fitted.judgement.adequacy
    model = evidence.model
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
    """Return the path from the grid to the optimum: start values, then the estimator's steps."""
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

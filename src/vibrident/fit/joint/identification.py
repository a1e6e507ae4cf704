"""The joint fit of several calibrations of one sensor, with a result for each."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.errors import InputError, ModelError
from vibrident.base.memory import in_one_thread
from vibrident.base.participants import watching
from vibrident.data.io import GivenCalibration, as_calibration
from vibrident.data.records import Calibration
from vibrident.data.screening.copies import share_data
from vibrident.fit.decay import decays_alone
from vibrident.fit.estimators import AUTO, Estimate, Estimator
from vibrident.fit.identification import fit
from vibrident.fit.information import inverse_normal
from vibrident.fit.joint.descent import Descent, JointProblem, descend
from vibrident.fit.joint.sharing import Consistency, compare, joined
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.document import Uncertainty, budget_of, document
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.uncertainty.budget import DATA, BudgetRow, row_of_effect
from vibrident.fit.uncertainty.parameters import parameter_table, parameter_units, unit_fields
from vibrident.physics.models import GivenModel, named
from vibrident.physics.naming import in_words
from vibrident.result import Parameter, Result, ResultWarning

#: Source of a calibration's uncertainty where its separate fit is not used.
RESIDUAL = "its residual at the joint fit, noise and misfit (its own fit is not used)"


@in_one_thread
@watching()
def identify_together(
    calibrations: Sequence[GivenCalibration],
    model: GivenModel | Sequence[GivenModel | None] | None = None,
    estimator: str | Estimator = AUTO,
    *,
    share: Sequence[str] | None = None,
    uncertainty: Uncertainty = "auto",
    progress: Progress = silent,
) -> tuple[Result, ...]:
    """Identify one sensor from several of its calibrations.

    The calibrations are by sine and by shock, for example, or of two outputs. Each keeps its own
    model, units and estimator. The parameters that they share are estimated once, from all of them,
    each weighted by its covariance. A calibration of free decays alone shares natural frequency and
    damping ratio.

    Args:
        calibrations: of one sensor, or paths of their calibration files.
        model: name of the sensor model, or a :class:`vibrident.Model`, one for all or one for each;
            None takes the calibration's.
        estimator: as for :func:`vibrident.identify`, for each by itself.
        share: names of the parameters to share, and no others. None: natural frequency, damping
            ratio, frequency and damping of a second mode; and where core model, unit of the
            response and kind of reference are the same also gain, ``mode2_gain``,
            ``cubic_stiffness``, ``highpass_frequency`` and ``boxcar_length``. A delay is shared
            only if named.
        uncertainty: as for :func:`vibrident.identify`.
        progress: called after each iteration of the optimiser.

    Returns:
        A result for each calibration, in order, with the joint values and their covariance.
        ``settings["joint"]`` names the companions, what was shared, each calibration's separate
        estimate, and whether these are consistent; if not, each result carries the warning
        ``estimators_disagree``, and the uncertainties by the data are enlarged by the Birge ratio
        √(χ²/ν) (Birge, Phys. Rev. 40 (1932) 207).

    Raises:
        InputError: the data cannot be used, a name is not a parameter, or nothing can be shared.
        ModelError: model, estimator and data do not fit together.
        NotConverged: no start leads to a finite fit.

    Examples:
        >>> import vibrident
        >>> tones = [100, 200, 400]
        >>> sine = vibrident.simulate(frequencies_hz=tones, samples=2000, response_noise=1e-3)
        >>> shock = vibrident.simulate("paper", "shock", samples=2000, response_noise=1e-3)
        >>> by_sine, by_shock = vibrident.identify_together([sine, shock])
        >>> by_sine.parameters["damping_ratio"].value == by_shock.parameters["damping_ratio"].value
        True
    """
    begin = time.perf_counter()
    calibrations = [as_calibration(calibration) for calibration in calibrations]
    _refuse_copies(calibrations)
    names = _models(model, len(calibrations))
    if isinstance(estimator, Estimator) and estimator.for_one_calibration:
        raise ModelError(
            "A learned residual belongs to one calibration.",
            expected="an estimator without it for a joint fit",
            found=f"{len(calibrations)} calibrations",
            where="⟦identify.estimator⟧",
            remedy="leave the residual out, or identify one calibration at a time",
        )
    fitted = tuple(
        fit(
            calibration,
            name,
            AUTO if decays_alone(calibration) else estimator,
            uncertainty=uncertainty,
            progress=progress,
        )
        for calibration, name in zip(calibrations, names, strict=True)
    )
    numbers = joined(calibrations, [separate.evidence.model for separate in fitted], share)
    descent = descend(
        JointProblem(fitted, numbers),
        lambda separate: budget_of(separate, uncertainty)[0].covariance,
        progress,
    )
    results = _documents(descent, uncertainty, _labels(calibrations))
    spent = time.perf_counter() - begin
    return tuple(
        replace(result, settings={**result.settings, "time_s": spent}) for result in results
    )


def _refuse_copies(calibrations: Sequence[Calibration]) -> None:
    """Refuse calibrations of which two hold the same measurement, which would count twice.

    Raises:
        InputError: names the calibrations.
    """
    labels = _labels(calibrations)
    for number, calibration in enumerate(calibrations):
        for earlier in range(number):
            if share_data(calibrations[earlier], calibration):
                raise InputError(
                    "Two calibrations hold the same measurement.",
                    expected="each record and each table in one calibration",
                    found=f"data of {labels[earlier]} in {labels[number]}, too",
                    where="calibrations",
                    remedy="leave it out of one of them",
                )


def _models(model: GivenModel | Sequence[GivenModel | None] | None, count: int) -> list[str | None]:
    """Return the name of the model of each calibration, None where it is the calibration's own.

    Raises:
        InputError: there are no calibrations, or more or fewer models.
    """
    if count == 0:
        raise InputError(
            "There is no calibration.", expected="one or more", found="none", where="calibrations"
        )
    if model is None or isinstance(model, GivenModel):
        return [named(model)] * count
    if len(model) != count:
        raise InputError(
            "The number of models is not that of the calibrations.",
            expected=f"one model for all, or {count}",
            found=f"{len(model)} models",
            where="⟦identify.model⟧",
            remedy="name one model, or as many as there are calibrations",
        )
    return [named(model_of_one) for model_of_one in model]


def _documents(descent: Descent, uncertainty: Uncertainty, labels: Sequence[str]) -> list[Result]:
    """Return the result of each calibration in the joint fit."""
    fitted = descent.problem.fitted
    places = descent.problem.places
    balance = descent.balance
    separate_rows = [budget_of(separate, uncertainty) for separate in fitted]
    data = [rows[0] for rows in separate_rows]
    for i in descent.unused:
        covariance = inverse_normal(balance.information[i])
        freedom = fitted[i].estimate.degrees_of_freedom
        data[i] = BudgetRow(RESIDUAL, DATA, None, "", freedom, covariance)
    consistency = _consistency(descent, data)
    birge = 1.0
    disagreements = []
    if consistency is not None and not consistency.overall.consistent:
        if uncertainty != "noise":
            birge = np.sqrt(consistency.overall.chi2 / consistency.overall.degrees_of_freedom)
        disagreements = [_disagreement(consistency, birge, labels, descent)]
    joint_rows = [  # with covariances of theta
        replace(
            row,
            source=f"{label}: {row.source}" if len(places) > 1 else row.source,
            covariance=birge**2 * balance.by_data(i),
        )
        for i, (row, label) in enumerate(zip(data, labels, strict=True))
    ]
    for number, effect in enumerate(descent.effects):
        shift = balance.by_effect(number)
        joint_rows.append(row_of_effect(effect.effect, np.outer(shift, shift)))
    results = []
    for i, place in enumerate(places):
        rows = [
            replace(row, covariance=place.matrix @ row.covariance @ place.matrix.T)
            for row in joint_rows
            if row.covariance.any()
        ]
        results.append(document(fitted[i].at(_estimate(descent, i)), rows, disagreements))
    if len(places) == 1:
        return results
    about = _about(descent, labels, results, separate_rows, consistency)
    return [
        replace(result, settings={**result.settings, "joint": {"position": i, **about}})
        for i, result in enumerate(results)
    ]


def _estimate(descent: Descent, index: int) -> Estimate:
    """Return a calibration's estimate in the joint fit."""
    fitted = descent.problem.fitted
    place = descent.problem.places[index]
    near = descent.near[index]
    estimate = fitted[index].estimate
    findings = estimate.findings
    problem = estimate.problem
    if index in descent.unused and findings.noise is not None:
        no_values = np.zeros(0)
        no_pulls = np.zeros((0, 0))
        findings = replace(
            findings,
            noise=replace(findings.noise, reference=no_values, doubt=no_values, pulls=no_pulls),
        )
    if near.noise is not None and findings.network is not None:
        findings = replace(findings, network=replace(findings.network, noise=near.noise))
        problem = near.problem
    theta = descent.balance.theta
    trace = descent.trace
    return replace(
        estimate,
        z=place.z(theta),
        covariance=place.matrix
        @ descent.balance.covariance[: len(theta), : len(theta)]
        @ place.matrix.T,
        trace=replace(trace, coordinates=place.offset + trace.coordinates @ place.matrix.T),
        problem=problem,
        findings=findings,
        tones=None,  # measured again, with the network's response at the joint values
        predicted=None,
        begin=None,
        equations=sum(fit.estimate.equations for fit in fitted),
    )


def _consistency(descent: Descent, data: Sequence[BudgetRow]) -> Consistency | None:
    """Return the comparison of the separate estimates, None if nothing is shared."""
    problem = descent.problem
    estimates = descent.balance.estimates
    shifts = [
        np.concatenate([effect.shifts.get(i, np.zeros(len(z))) for i, z in enumerate(estimates)])
        for effect in descent.effects
    ]
    return compare(
        problem.numbers,
        problem.places,
        estimates,
        [row.covariance for row in data],
        shifts,
        min(row.degrees_of_freedom for row in data),
    )


def _labels(calibrations: Sequence[Calibration]) -> list[str]:
    """Return a short name for each calibration: that of its file, with the folder if ambiguous."""
    names = [
        Path(calibration.source).name or f"calibration {i}"
        for i, calibration in enumerate(calibrations, 1)
    ]
    return [
        name if names.count(name) == 1 else calibration.source or f"calibration {i}"
        for i, (name, calibration) in enumerate(zip(names, calibrations, strict=True), 1)
    ]


def _disagreement(
    consistency: Consistency,
    birge: float,
    labels: Sequence[str],
    descent: Descent,
) -> ResultWarning:
    """Return the warning of calibrations that are not consistent."""
    name = consistency.worst
    overall = consistency.overall
    fitted = descent.problem.fitted
    values = []
    number = next(
        parameter
        for parameter in descent.problem.numbers
        if parameter.name == name and len(parameter.members) > 1
    )
    for owner, _ in number.members:
        estimate = fitted[owner].estimate
        unit = parameter_units(estimate.coordinates.model, fitted[owner].evidence.calibration)[name]
        text = (
            amount(estimate.coordinates.values(estimate.z)[name], unit, 6)
            if owner not in descent.unused
            else "elsewhere"
        )
        values.append(f"{text} ({labels[owner]})")
    worst_sentence = (
        f"The {in_words(name)} differs most: {', '.join(values)}. "
        if name in consistency.by_name
        else ""
    )
    return ResultWarning(
        "estimators_disagree",
        f"The calibrations disagree on what they share: χ² = {overall.chi2:.4g} with "
        f"{overall.degrees_of_freedom} degrees of freedom, "
        f"probability {overall.probability:.2g}. {worst_sentence}"
        + (
            f"The uncertainties of the joint values are enlarged by the Birge ratio, {birge:.3g}."
            if birge > 1.0
            else "The uncertainties of the joint values do not cover the difference."
        ),
    )


def _about(
    descent: Descent,
    labels: Sequence[str],
    results: Sequence[Result],
    rows: Sequence[Sequence[BudgetRow]],
    consistency: Consistency | None,
) -> dict[str, Any]:
    """Return the content of ``settings["joint"]``; ``rows``: budget of each separate fit."""
    separate = [
        {} if i in descent.unused else _separate_parameters(fit, rows[i])
        for i, fit in enumerate(descent.problem.fitted)
    ]
    shared = []
    for number in descent.problem.numbers:
        if len(number.members) < 2:
            continue
        owners = [owner for owner, _ in number.members]
        joint = results[owners[0]].parameters[number.name]
        verdict = None if consistency is None else consistency.by_name.get(number.name)
        shared.append(
            {
                "name": number.name,
                "unit": joint.unit,
                "joint": _value_and_uncertainty(joint),
                "separate": {
                    labels[owner]: _value_and_uncertainty(separate[owner].get(number.name))
                    for owner in owners
                },
                "chi2": None if verdict is None else verdict.chi2,
                "probability": None if verdict is None else verdict.probability,
            }
        )
    overall = None if consistency is None else consistency.overall
    return {
        "calibrations": [
            {
                "file": label,
                "model": result.model,
                "estimator": result.estimator,
                "own_fit_used": i not in descent.unused,
            }
            for i, (label, result) in enumerate(zip(labels, results, strict=True))
        ],
        "shared": shared,
        "consistency": None
        if overall is None
        else {**asdict(overall), "consistent": overall.consistent},
    }


def _separate_parameters(fitted: Fitted, rows: Sequence[BudgetRow]) -> dict[str, Parameter]:
    """Return the parameters of a separate fit, with uncertainties by all rows of its budget."""
    estimate = fitted.estimate
    covariance = np.sum([row.covariance for row in rows], axis=0)
    units = unit_fields(fitted.evidence.calibration)
    return parameter_table(
        estimate.coordinates, estimate.z, covariance, rows[0].degrees_of_freedom, units, {}
    )


def _value_and_uncertainty(parameter: Parameter | None) -> dict[str, float | None] | None:
    """Return value and standard uncertainty of a parameter for the settings."""
    if parameter is None:
        return None
    return {"value": parameter.value, "standard_uncertainty": parameter.standard_uncertainty}

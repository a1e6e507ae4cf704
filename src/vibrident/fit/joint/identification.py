"""Several calibrations of one sensor → one joint fit → a result for each."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.base.amounts import amount
from vibrident.base.errors import InputError, ModelError
from vibrident.base.memory import in_one_thread
from vibrident.data.records import Calibration, FloatArray, SystematicEffect
from vibrident.fit.decay import decays_alone
from vibrident.fit.descent.optimise import Progress, silent
from vibrident.fit.estimators import AUTO, Estimate, Estimator
from vibrident.fit.identification import fit, identify
from vibrident.fit.information import inverse_normal
from vibrident.fit.joint.decays import FreeDecays
from vibrident.fit.joint.descent import Descent, Together, descend
from vibrident.fit.joint.sharing import Consistency, compare, joined
from vibrident.fit.judge import Fitted, Uncertainty, document, own_rows
from vibrident.fit.judge.effects import all_effects
from vibrident.fit.uncertainty.budget import DATA, BudgetRow, row_of_effect, shift_of_effect
from vibrident.fit.uncertainty.parameters import parameter_table, parameter_units, unit_fields
from vibrident.physics.naming import in_words
from vibrident.result import Parameter, Result, ResultWarning

#: Coverage of a calibration whose own fit is not used.
RESIDUAL = "its residual at the joint fit, noise and misfit (its own fit is not used)"


@in_one_thread
def identify_together(
    calibrations: Sequence[Calibration],
    model: str | Sequence[str | None] | None = None,
    estimator: str | Estimator = AUTO,
    *,
    share: Sequence[str] | None = None,
    uncertainty: Uncertainty = "auto",
    progress: Progress = silent,
) -> tuple[Result, ...]:
    """Identify one sensor from several of its calibrations: by sine and by shock, or by two of its outputs.

    Each calibration keeps its own model, units and estimator. What they share is estimated once, from all of them, each
    weighted by its own covariance. One of free decays alone shares natural frequency and damping ratio.

    Args:
        calibrations: of one sensor.
        model: name of the sensor model, one for all or one for each; None takes the calibration's.
        estimator: as for :func:`vibrident.identify`, for each by itself.
        share: names of the parameters to share, and no others. None: natural frequency, damping ratio, frequency
            and damping of a second mode; and where core model, unit of the response and kind of reference are the same
            also gain, ``mode2_gain``, ``cubic_stiffness``, ``highpass_frequency`` and ``boxcar_length``. A delay is
            shared only if named.
        uncertainty: as for :func:`vibrident.identify`.
        progress: called after each iteration of the optimiser.

    Returns:
        a result for each calibration, in order, with the joint values and their covariance. ``settings["joint"]`` names
        the companions, what was shared, each calibration's separate estimate, and whether these are consistent; if not,
        each result carries the warning ``estimators_disagree``.

    Raises:
        InputError: the data cannot be used, a name is not a parameter, nothing can be shared, or several calibrations
            hold free decays alone and no other is there.
        ModelError: model, estimator and data do not fit together.
        NotConverged: no start leads to a finite fit.
    """
    begin = time.perf_counter()
    names = _models(model, len(calibrations))
    if isinstance(estimator, Estimator) and estimator.for_one_calibration:
        raise ModelError(
            "A learned residual belongs to one calibration.",
            expected="an estimator without it for a joint fit",
            found=f"{len(calibrations)} calibrations",
            where="estimator",
            remedy="leave the residual out, or identify one calibration at a time",
        )
    _require_a_reference(calibrations)
    if len(calibrations) == 1 and decays_alone(calibrations[0]):
        return (identify(calibrations[0], names[0], estimator, uncertainty=uncertainty, progress=progress),)
    free = [i for i, one in enumerate(calibrations) if decays_alone(one)]
    led = [i for i in range(len(calibrations)) if i not in free]
    fitted = [fit(calibrations[i], names[i], estimator, uncertainty=uncertainty, progress=progress) for i in led]
    decays = [FreeDecays.of(calibrations[i], names[i], inflate=uncertainty != "noise") for i in free]
    numbers = joined([calibrations[i] for i in led], [one.evidence.model for one in fitted], share)
    together = Together(tuple(fitted), tuple(decays), numbers)
    descent = descend(together, lambda one: own_rows(one, uncertainty)[0].covariance, progress)
    order = [*led, *free]
    labels = _labels([calibrations[i] for i in order], order)
    results = dict(zip(order, _documents(descent, uncertainty, labels, begin), strict=True))
    spent = time.perf_counter() - begin
    return tuple(
        replace(results[i], settings={**results[i].settings, "time_s": spent}) for i in range(len(calibrations))
    )


def _require_a_reference(calibrations: Sequence[Calibration]) -> None:
    """Free decays join other data; alone they are identified as one calibration."""
    if len(calibrations) > 1 and all(decays_alone(one) for one in calibrations):
        raise InputError(
            "A joint fit needs a calibration with a reference, or a table.",
            expected="one file at least that is not of free decays alone",
            found="excitation 'decay' in every record of every file",
            where="calibrations",
            remedy="list all decays under [[records]] of one file, and identify that",
        )


def _models(model: str | Sequence[str | None] | None, count: int) -> list[str | None]:
    if count == 0:
        raise InputError("There is no calibration.", expected="one or more", found="none", where="calibrations")
    if model is None or isinstance(model, str):
        return [model] * count
    if len(model) != count:
        raise InputError(
            "The number of models is not that of the calibrations.",
            expected=f"one model for all, or {count}",
            found=f"{len(model)} models",
            where="model",
            remedy="name one model, or as many as there are calibrations",
        )
    return list(model)


@dataclass(frozen=True, eq=False)
class _Effect:
    """A systematic effect, with the change of each calibration that has it, (p,), and of the joint fit, (q,)."""

    effect: SystematicEffect
    shifts: dict[int, FloatArray]
    theta: FloatArray


def _documents(descent: Descent, uncertainty: Uncertainty, labels: Sequence[str], begin: float) -> list[Result]:
    fitted, decays, places = descent.together.fitted, descent.together.decays, descent.together.places
    placed = [one.at(_estimate(descent, i)) for i, one in enumerate(fitted)]
    alone = [own_rows(one, uncertainty)[0] for one in fitted]
    data = [row if i in descent.alone else _left(descent, i) for i, row in enumerate(alone)]
    data += [one.row for one in decays]
    effects = _effects(descent, placed)
    consistency = _consistency(descent, data, effects)
    told = [] if consistency is None or consistency.whole.consistent else [_disagreement(consistency, labels, descent)]
    results = []
    for i, place in enumerate(places):
        onto = place.matrix
        rows = [_data_row(descent, i, j, row, labels[j] if len(places) > 1 else "") for j, row in enumerate(data)]
        rows += [row_of_effect(e.effect, np.outer(onto @ e.theta, onto @ e.theta)) for e in effects if np.any(e.theta)]
        if i < len(placed):
            results.append(document(placed[i], rows, told))
        else:
            results.append(decays[i - len(placed)].result(place.z(descent.balance.theta), rows, told, begin))
    if len(places) == 1:
        return results
    separate = [_alone(one, uncertainty) if i in descent.alone else None for i, one in enumerate(fitted)]
    separate += [one.alone() for one in decays]
    about = _about(descent, labels, results, separate, consistency)
    return [
        replace(result, settings={**result.settings, "joint": {"position": i, **about}})
        for i, result in enumerate(results)
    ]


def _estimate(descent: Descent, index: int) -> Estimate:
    """A calibration's estimate in the joint fit."""
    fitted, place, near = descent.together.fitted, descent.together.places[index], descent.near[index]
    estimate = fitted[index].estimate
    findings, more = estimate.findings, {}
    if index not in descent.alone and findings.noise is not None:
        nothing, none = np.zeros(0), np.zeros((0, 0))
        findings = replace(findings, noise=replace(findings.noise, reference=nothing, doubt=nothing, pulls=none))
    if near.noise is not None and findings.network is not None:
        findings = replace(findings, network=replace(findings.network, noise=near.noise))
        more["problem"] = near.network
    theta, trace = descent.balance.theta, descent.trace
    return replace(
        estimate,
        z=place.z(theta),
        covariance=place.matrix @ descent.balance.covariance @ place.matrix.T,
        trace=replace(trace, coordinates=place.offset + trace.coordinates @ place.matrix.T),
        findings=findings,
        tones=None,  # measured again, with the network's response at the joint values
        predicted=None,
        begin=None,
        equations=sum(one.estimate.equations for one in fitted),
        **more,
    )


def _left(descent: Descent, index: int) -> BudgetRow:
    """The data row of a calibration whose own fit is not used."""
    covariance = inverse_normal(descent.balance.information[index])
    return BudgetRow(RESIDUAL, DATA, None, "", descent.together.fitted[index].estimate.degrees_of_freedom, covariance)


def _data_row(descent: Descent, index: int, other: int, row: BudgetRow, label: str) -> BudgetRow:
    """Contribution of the data of calibration ``other`` to the covariance of calibration ``index``."""
    places = descent.together.places
    gain = descent.balance.covariance @ places[other].matrix.T
    share = gain @ descent.balance.information[other] @ gain.T
    onto = places[index].matrix
    source = f"{label}: {row.source}" if label else row.source
    return replace(row, source=source, covariance=onto @ share @ onto.T)


def _effects(descent: Descent, placed: Sequence[Fitted]) -> list[_Effect]:
    """Every systematic effect once: equal statements in two calibrations are one effect, as of one instrument."""
    found: dict[SystematicEffect, dict[int, FloatArray]] = {}
    for index, one in enumerate(placed):
        for effect in all_effects(one.evidence, one.judgement):
            found.setdefault(effect, {})[index] = shift_of_effect(effect, one.linear)
    for index, one in enumerate(descent.together.decays, len(placed)):
        for effect in one.calibration.effects:
            if effect.kind == "clock":  # all frequencies scale with it; no other effect reaches a decay
                found.setdefault(effect, {})[index] = np.array([effect.standard_uncertainty, 0.0])
    places, information = descent.together.places, descent.balance.information
    effects = []
    for effect, shifts in found.items():
        pull = sum(places[i].matrix.T @ information[i] @ s for i, s in shifts.items())
        effects.append(_Effect(effect, shifts, descent.balance.covariance @ np.asarray(pull)))
    return effects


def _consistency(descent: Descent, data: Sequence[BudgetRow], effects: Sequence[_Effect]) -> Consistency | None:
    together, theta = descent.together, descent.balance.theta
    steps = zip(together.at(theta), descent.balance.steps, strict=True)
    estimates = [z + step for z, step in steps]
    for i in descent.alone:
        estimates[i] = together.fitted[i].estimate.z
    for one, place in zip(together.decays, together.places[len(together.fitted) :], strict=True):
        estimates.append(one.estimate(float(place.z(theta)[1])))
    sizes = [len(z) for z in estimates]
    stacked = [np.concatenate([e.shifts.get(i, np.zeros(size)) for i, size in enumerate(sizes)]) for e in effects]
    fewest = min(row.degrees_of_freedom for row in data)
    covariances = [row.covariance for row in data]
    return compare(together.whole, together.places, estimates, covariances, stacked, fewest)


def _labels(calibrations: Sequence[Calibration], numbers: Sequence[int]) -> list[str]:
    """A short name for each calibration: its file, with the folder where files share a name."""
    names = [Path(one.source).name or f"calibration {i + 1}" for i, one in zip(numbers, calibrations, strict=True)]
    return [
        name if names.count(name) == 1 else one.source or f"calibration {i + 1}"
        for i, name, one in zip(numbers, names, calibrations, strict=True)
    ]


def _disagreement(consistency: Consistency, labels: Sequence[str], descent: Descent) -> ResultWarning:
    name, whole = consistency.worst, consistency.whole
    fitted, values = descent.together.fitted, []
    number = next(n for n in descent.together.whole if n.name == name and len(n.members) > 1)
    for owner, _ in number.members:
        if owner >= len(fitted):
            own = descent.together.decays[owner - len(fitted)].alone()[name]
            values.append(f"{amount(own.value, own.unit, 6)} ({labels[owner]})")
            continue
        estimate = fitted[owner].estimate
        unit = parameter_units(estimate.coordinates.model, fitted[owner].evidence.calibration)[name]
        text = amount(estimate.coordinates.values(estimate.z)[name], unit, 6) if owner in descent.alone else "elsewhere"
        values.append(f"{text} ({labels[owner]})")
    said = f"The {in_words(name)} differs most: {', '.join(values)}. " if name in consistency.each else ""
    return ResultWarning(
        "estimators_disagree",
        f"The calibrations disagree on what they share: χ² = {whole.chi2:.4g} with {whole.degrees_of_freedom} degrees "
        f"of freedom, probability {whole.probability:.2g}. {said}The joint values lie between them; their "
        "uncertainties do not cover the difference.",
    )


def _about(
    descent: Descent,
    labels: Sequence[str],
    results: Sequence[Result],
    separate: Sequence[Mapping[str, Parameter] | None],
    consistency: Consistency | None,
) -> dict[str, Any]:
    """The content of ``settings["joint"]``."""
    shared = []
    for number in descent.together.whole:
        if len(number.members) < 2:
            continue
        owners = [owner for owner, _ in number.members]
        joint = results[owners[0]].parameters[number.name]
        verdict = None if consistency is None else consistency.each.get(number.name)
        shared.append(
            {
                "name": number.name,
                "unit": joint.unit,
                "joint": _stated(joint),
                "separate": {labels[o]: _stated((separate[o] or {}).get(number.name)) for o in owners},
                "chi2": None if verdict is None else verdict.chi2,
                "probability": None if verdict is None else verdict.probability,
            }
        )
    whole = None if consistency is None else consistency.whole
    used = (*descent.alone, *range(len(descent.together.fitted), len(labels)))
    return {
        "calibrations": [
            {"file": label, "model": r.model, "estimator": r.estimator, "own_fit_used": i in used}
            for i, (label, r) in enumerate(zip(labels, results, strict=True))
        ],
        "shared": shared,
        "consistency": None if whole is None else {
            "chi2": whole.chi2,
            "degrees_of_freedom": whole.degrees_of_freedom,
            "probability": whole.probability,
            "consistent": whole.consistent,
        },
    }  # fmt: skip


def _alone(one: Fitted, uncertainty: Uncertainty) -> dict[str, Parameter]:
    """The parameters of a separate fit, with its whole budget."""
    rows, estimate = own_rows(one, uncertainty), one.estimate
    covariance = np.sum([row.covariance for row in rows], axis=0)
    units = unit_fields(one.evidence.calibration)
    return parameter_table(estimate.coordinates, estimate.z, covariance, rows[0].degrees_of_freedom, units, {})


def _stated(parameter: Parameter | None) -> dict[str, float | None] | None:
    if parameter is None:
        return None
    return {"value": parameter.value, "standard_uncertainty": parameter.standard_uncertainty}

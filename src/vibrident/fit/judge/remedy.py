"""Remedy for a lack of fit: the model that explains data which the requested one does not."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.errors import VibridentError
from vibrident.fit.descent.train import MIN_EXPLAINED_SHARE
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.problem import Coordinates, Evidence, FrequencyProblem
from vibrident.fit.start.start import Start, extended, find_start
from vibrident.fit.uncertainty.parameters import standard_uncertainties
from vibrident.physics.models import ADD_ONS, CORES, SensorModel, installed

#: Degrees of freedom that must remain to judge a model by.
MIN_FREEDOM = 4
#: Records that are furthest off, of which one may be all that is wrong.
MAX_SUSPECTS = 12
#: χ²/ν at the points alone that is little.
MAX_SMALL_CHI2 = 1.5


def with_remedy(fitted: Fitted) -> Fitted:
    """Return the fit, its judgement with the model that explains what its own does not, if any.

    Where that is an extension of the fit's own, which explains as much from its values, the fit is
    the one from there. Models are tried at the excited frequencies, from the values of the present
    one, and the likely ones by one fit of the records from there.
    """
    declared = fitted.judgement.adequacy.chi2_reduced or 0.0
    if fitted.adequate or declared <= 0.0 or not _may_lack_model(fitted):
        return fitted
    fitted = _with_record_apart(fitted)
    evidence = fitted.evidence
    judgement = fitted.judgement
    for candidate, values in itertools.islice(_likely_models(fitted), 2):
        try:
            better = fitted.once(replace(evidence, model=candidate, start=values))
        except VibridentError:
            continue
        if better.adequate:
            nested = _nested(fitted, better)
            if nested is not None:
                return nested
            chi2 = better.judgement.adequacy.chi2_reduced or 0.0
            text = f"The model {candidate.name} explains them (χ²/dof = {plain(chi2, 3)})."
            judgement = replace(
                judgement,
                lack_of_fit=f"{judgement.lack_of_fit} {text}",
                remedy_chi2=chi2,
                explained_by=candidate.name,
            )
            return replace(fitted, judgement=judgement)
    return fitted


def _with_record_apart(fitted: Fitted) -> Fitted:
    """Return the fit of sines, its judgement with the one record without which the model suffices.

    Without it the points have a tenth of the χ² that they have without any other record that is far
    off. What is stated is the χ² of a fit without it.
    """
    evidence = fitted.evidence
    problem = evidence.first_look
    tones = fitted.judgement.tones
    points = fitted.judgement.tone_points
    measured = evidence.tones
    if measured is None or problem is None or tones is None or points is None:
        return fitted
    if not evidence.only_sines:
        return fitted
    records = measured.record
    squares = np.bincount(tones.record, weights=points.squares, minlength=len(evidence.records))
    furthest = np.argsort(-squares)[:MAX_SUSPECTS]
    starts: list[tuple[float, int, dict[str, float]]] = []
    for number in furthest[np.isin(furthest, records)].tolist():
        data = tuple(values[records != number] for values in problem.data)
        start = _start_of_model(replace(problem, data=data), evidence.model, fitted, math.inf)
        if start is not None:
            starts.append((start.costs[-1], number, start.values))
    starts.sort(key=lambda entry: entry[0])
    if len(starts) < MIN_FREEDOM or starts[0][0] > 0.1 * starts[1][0]:
        return fitted
    _, number, values = starts[0]
    remaining = tuple(record for k, record in enumerate(evidence.records) if k != number)
    try:
        refit = fitted.once(replace(evidence.with_records(remaining), start=values))
    except VibridentError:
        return fitted
    if not refit.adequate:
        return fitted
    chi2 = refit.judgement.adequacy.chi2_reduced or 0.0
    text = (
        f"Without {evidence.records[number].name} the model explains them (χ²/dof = "
        f"{plain(chi2, 3)}): was that taken with another sensor, range or wiring?"
    )
    judgement = fitted.judgement
    judgement = replace(judgement, lack_of_fit=f"{judgement.lack_of_fit} {text}")
    return replace(fitted, judgement=judgement)


def _nested(fitted: Fitted, better: Fitted) -> Fitted | None:
    """Return the fit from the values of an extended model, or None where it is rejected, too.

    Where what the other model has in addition is zero, the fit had ended at a wrong place.
    """
    if not set(fitted.values) < set(better.values) or _needs_additions(fitted, better):
        return None
    start = {name: better.values[name] for name in fitted.values}
    try:
        nested = fitted.once(replace(fitted.evidence, start=start))
    except VibridentError:
        return None
    return replace(nested, evidence=fitted.evidence) if nested.adequate else None


def _needs_additions(fitted: Fitted, better: Fitted) -> bool:
    """Return whether what an extended model has in addition differs much from zero.

    Without a parameter, χ² is larger by the square of its standard uncertainties from zero: none is
    so near that χ² would be less than twice its degrees of freedom.
    """
    estimate = better.estimate
    u = standard_uncertainties(estimate.coordinates, estimate.z, estimate.covariance)
    added = set(better.values) - set(fitted.values)
    freedom = better.judgement.adequacy.degrees_of_freedom
    return all(better.values[name] ** 2 > freedom * u[name] ** 2 for name in added)


def _may_lack_model(fitted: Fitted) -> bool:
    """Return whether the model may be at fault.

    It is not where its discretisation may be, or where a linear model explains hardly any motion.
    """
    findings = fitted.estimate.findings
    untestable = fitted.judgement.adequacy.degrees_of_freedom < MIN_FREEDOM
    network = findings.network
    plain_fit = (
        findings.learned is None
        and (network is None or network.optimiser != "adam")
        and findings.method.is_exact
    )
    if fitted.evidence.broadband:
        untestable |= fitted.judgement.explained < MIN_EXPLAINED_SHARE
    return fitted.evidence.model.is_linear and plain_fit and not untestable


def _likely_models(fitted: Fitted) -> Iterator[tuple[SensorModel, dict[str, float]]]:
    """Yield the models worth a fit of the records, with their parameters at the points.

    Models with the fewest parameters come first.
    """
    for problem in _sets_of_points(fitted):
        chi2_reduced = _reduced_chi2(problem, fitted)
        if chi2_reduced < 1.0:  # these points do not reject it
            continue
        for models in _other_models(fitted.evidence):
            likely = _models_that_explain(problem, models, fitted, chi2_reduced)
            if likely:
                yield from likely
                return


def _sets_of_points(fitted: Fitted) -> Iterator[FrequencyProblem]:
    """Yield the nonparametric response of the data, and then that beside the fit.

    The first leaks by its window; the second knows no such leakage, but what a wrong model leaves
    of a resonance leaks into it.
    """
    problem = fitted.evidence.first_look
    if problem is None:
        return
    yield problem
    if not problem.polar:
        yield replace(problem, data=fitted.judgement.adequacy.as_data)


def _reduced_chi2(problem: FrequencyProblem, fitted: Fitted) -> float:
    """Return the least χ²/ν of the present model at points; 0 where it has none."""
    model = fitted.evidence.model
    freedom = problem.equations - len(model.parameter_names)
    start = _start_of_model(problem, model, fitted, math.inf) if freedom > 0 else None
    return 0.0 if start is None else start.costs[-1] / freedom


def _models_that_explain(
    problem: FrequencyProblem,
    models: Sequence[SensorModel],
    fitted: Fitted,
    chi2_reduced: float,
) -> list[tuple[SensorModel, dict[str, float]]]:
    """Return models whose χ²/ν is a tenth of the present one's or small, with their parameters.

    It is no more than 30 times that of the best model. Larger models are tried where no smaller one
    has a small χ²/ν.

    Args:
        problem: the points.
        models: to be tried, those with the fewest parameters first.
        fitted: the fit by the present model.
        chi2_reduced: of the present model at the points.
    """
    candidates: list[tuple[SensorModel, dict[str, float], float]] = []
    max_cost = min(max(chi2_reduced / 10.0, MAX_SMALL_CHI2), 0.5 * chi2_reduced)
    least = chi2_reduced
    for candidate in models:
        freedom = problem.equations - len(candidate.parameter_names)
        if candidates and least < MAX_SMALL_CHI2 and _is_larger(candidate, candidates[-1][0]):
            break
        if freedom < MIN_FREEDOM:
            continue
        start = _start_of_model(problem, candidate, fitted, max_cost * freedom)
        if start is not None and _lies_inside(problem, candidate, start.values):
            candidates.append((candidate, start.values, start.costs[-1] / freedom))
            least = min(least, candidates[-1][-1])
    limit = max(min(chi2_reduced / 10.0, 30.0 * least), MAX_SMALL_CHI2)
    return [
        (candidate, values) for candidate, values, cost in candidates if cost < min(limit, max_cost)
    ]


def _is_larger(candidate: SensorModel, tried: SensorModel) -> bool:
    """Return whether a model has more parameters than another."""
    return len(candidate.parameter_names) > len(tried.parameter_names)


def _start_of_model(
    problem: FrequencyProblem, candidate: SensorModel, fitted: Fitted, max_cost: float
) -> Start | None:
    """Return the start of a model at the points, or None where its cost is above the limit.

    A model that extends the present one starts from the values of that.
    """
    problem_of_candidate = replace(problem, model=candidate, start=None)
    try:
        if set(fitted.evidence.model.parameter_names) <= set(candidate.parameter_names):
            return extended(problem_of_candidate, candidate, fitted.values, max_cost)
        return find_start(problem_of_candidate, candidate, max_cost)
    except VibridentError:
        return None


def _lies_inside(
    problem: FrequencyProblem, candidate: SensorModel, values: dict[str, float]
) -> bool:
    """Return whether no frequency is at an end of the range searched, where it explains nothing."""
    coordinates = Coordinates.at(candidate, values, problem.band_hz)
    z = coordinates.first
    low, high = coordinates.edges
    return all(
        low[k] < z[k] < high[k] for k, spec in enumerate(candidate.parameters) if spec.kind == "log"
    )


def _other_models(evidence: Evidence) -> Iterator[list[SensorModel]]:
    """Yield linear models of another core or with one more add-on; then those with a delay too.

    Each of the two comes as a list of models, those with the fewest parameters first.
    """
    present = evidence.model.name.split("+")
    # In data of a single mounting, a mounting is the same as a second mode, which is tried.
    add_ons = [
        addon for addon in ADD_ONS.values() if addon.force is None and not addon.before_sensor
    ]
    if evidence.broadband:  # broadband motion needs a network
        add_ons = [addon for addon in add_ons if addon.factor is None]
    additional = [addon.name for addon in add_ons if addon.name not in present]
    delays = [addon.name for addon in add_ons if addon.is_delay and addon.name in additional]
    # A gain alone is a limit of the other cores.
    cores = [
        name
        for name, core in CORES.items()
        if name != present[0]
        and len(core.parameters) > 1
        and core.behind in ("any", evidence.model.core.behind)
    ]
    # Cores come last: an add-on may do the same, and keeps the names of the parameters.
    one_more = [[*present, name] for name in additional]
    one_more += [[core, *present[1:]] for core in cores]
    with_delay = [
        [*present, name, delay]
        for delay in delays
        for name in additional
        if not ADD_ONS[name].is_delay
    ]
    for names in (one_more, with_delay):
        models = (installed("+".join(components)) for components in names)
        linear = [model for model in models if model is not None and model.is_linear]
        yield sorted(linear, key=lambda model: len(model.parameters))

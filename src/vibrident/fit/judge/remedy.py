"""Which model explains data that the model asked for does not."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.errors import VibridentError
from vibrident.fit.estimators.optimise import levenberg_marquardt, silent
from vibrident.fit.estimators.start import find_start
from vibrident.fit.judge.adequacy import Judgement
from vibrident.fit.judge.attempts import Attempt
from vibrident.fit.problem import Coordinates, Evidence, FrequencyProblem
from vibrident.physics.models import ADD_ONS, CORES, SensorModel, installed

#: Another model is tried if its χ²/ν at the points is so many times smaller …
BETTER = 10.0
#: … with this many degrees of freedom left to judge it by.
LEAST_FREE = 4
#: Where it is so many times smaller, what else the residual shows is misfit.
ALL_MISFIT = 100.0
#: At the points alone, models count that leave this or less in χ²/ν, or so many times the least; so many are fitted.
WELL, ALIKE, MOST_TRIED = 1.5, 30.0, 3
#: The response before any model is of bands, within which it changes: relative deviation that a right model may have.
ROUGH = 0.02


def with_remedy(found: Attempt) -> Attempt:
    """The attempt, its judgement with the model that explains what the present one does not, if there is one.

    Models are tried at the excited frequencies, the likely ones then by one fit from the values found there.
    """
    evidence, judgement = found.evidence, found.judgement
    declared = judgement.adequacy.chi2_reduced or 0.0
    if found.adequate or declared <= 0.0 or not _may_be_the_model(found):
        return found
    for other, values in itertools.islice(_tried(evidence, judgement), MOST_TRIED):
        try:
            better = found.once(replace(Evidence.gather(evidence.calibration, other), start=values))
        except VibridentError:
            continue
        if better.adequate:
            chi2 = better.judgement.adequacy.chi2_reduced or 0.0
            text = f"{judgement.lack_of_fit} The model {other.name} explains them (χ²/dof = {plain(chi2, 3)})."
            remedied = chi2 * ALL_MISFIT < declared
            judgement = replace(judgement, lack_of_fit=text, remedied=remedied)
            return replace(found, judgement=judgement, drifts=() if remedied else found.drifts)
    return found


def _may_be_the_model(found: Attempt) -> bool:
    """Whether the model may be at fault: not its discretisation, nor what no linear model explains."""
    findings, few = found.estimate.findings, found.judgement.adequacy.degrees_of_freedom < LEAST_FREE
    network = findings.network
    plain_fit = (
        findings.learned is None and (network is None or network.optimiser != "adam") and findings.method.is_exact
    )
    return found.evidence.model.is_linear and plain_fit and not few and not found.judgement.overtones


def _tried(evidence: Evidence, judgement: Judgement) -> Iterator[tuple[SensorModel, dict[str, float]]]:
    """The models worth a fit of the records, with their values at the points: those of one thing more come first."""
    problems = list(_problems(evidence, judgement))
    for others in _others(evidence):
        for problem in problems:
            likely = sorted(_likely(problem, others), key=lambda found: len(found[1]))
            yield from likely
            if likely:
                break


def _problems(evidence: Evidence, judgement: Judgement) -> Iterator[FrequencyProblem]:
    """The response at the excited frequencies: of a table or beside the fit, and that of bands before any model."""
    points, first = judgement.adequacy, evidence.first_look
    if first is None or first.polar:
        yield from () if first is None else (first,)
        return
    size = np.abs(points.measured)
    data = (points.frequency_hz, np.ones(len(size), complex), points.measured, points.relative_deviation * size)
    yield replace(first, data=data)
    if evidence.bands is not None:
        frequency, reference, response, deviation = first.data
        data = (frequency, reference, response, np.hypot(deviation, ROUGH * np.abs(response)))
        yield replace(first, data=data)


def _likely(problem: FrequencyProblem, others: Sequence[SensorModel]) -> Iterator[tuple[SensorModel, dict[str, float]]]:
    """Those models that leave least of the response."""
    own, _ = _left(problem, problem.model)
    found = [(other, *_left(problem, other)) for other in others]
    least = min([own / BETTER, *(cost * ALIKE for _, cost, _ in found)])
    for other, cost, values in found:
        if cost < min(max(least, WELL), 0.5 * own):
            yield other, values


def _left(problem: FrequencyProblem, model: SensorModel) -> tuple[float, dict[str, float]]:
    """χ²/ν of a model at the points, with its values; infinite where too few degrees of freedom are left."""
    free = problem.equations - len(model.parameter_names)
    if free < LEAST_FREE:
        return np.inf, {}
    try:
        start = find_start(replace(problem, model=model), model)
        coordinates = Coordinates.at(model, start.values, problem.band_hz)
        trace = levenberg_marquardt(problem.normal, coordinates.first, coordinates, progress=silent)
    except VibridentError:
        return np.inf, {}
    return float(trace.costs[-1]) / free, coordinates.values(trace.last)


def _others(evidence: Evidence) -> Iterator[list[SensorModel]]:
    """Linear models of another core or with one more add-on; then those with one more and a delay."""
    own, possible = evidence.model.name.split("+"), [addon for addon in ADD_ONS.values() if addon.force is None]
    if evidence.bands is not None:  # broadband motion needs a network
        possible = [addon for addon in possible if addon.factor is None]
    more = [addon.name for addon in possible if addon.name not in own]
    delays = [addon.name for addon in possible if addon.is_delay and addon.name in more]
    one = [[core, *own[1:]] for core in CORES if core != own[0]] + [[*own, name] for name in more]
    two = [[*own, name, delay] for delay in delays for name in more if not ADD_ONS[name].is_delay]
    for names in (one, two):
        models = (installed("+".join(parts)) for parts in names)
        yield [model for model in models if model is not None and model.is_linear]

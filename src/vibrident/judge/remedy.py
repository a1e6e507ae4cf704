"""Which model explains data that the model asked for does not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vibrident.errors import VibridentError
from vibrident.estimators import Estimate, Estimator
from vibrident.estimators.optimise import Progress, levenberg_marquardt, silent
from vibrident.estimators.start import find_start
from vibrident.judge.adequacy import Judgement
from vibrident.judge.attempts import fitted_and_judged
from vibrident.models import CORES, SensorModel, installed
from vibrident.naming import plain
from vibrident.problem import Coordinates, Evidence, FrequencyProblem

#: What is added to a model; a boxcar needs sines or a table.
WITH_NETWORK = ("delay", "highpass", "mode2", "highpass+delay", "mode2+delay")
ADDED = (*WITH_NETWORK, "boxcar", "boxcar+delay")
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


def with_remedy(
    evidence: Evidence, estimate: Estimate, judgement: Judgement, estimator: Estimator, progress: Progress
) -> Judgement:
    """The judgement with the model that explains what the present one does not, if there is one.

    Models are tried at the excited frequencies, the likely ones then by a whole fit.
    """
    declared = judgement.adequacy.chi2_reduced or 0.0
    if judgement.adequacy.adequate or declared <= 0.0 or not _may_be_the_model(evidence, estimate, judgement):
        return judgement
    for other in _tried(evidence, judgement):
        try:
            _, found = fitted_and_judged(Evidence.gather(evidence.calibration, other), estimator, progress)
        except VibridentError:
            continue
        if found.adequacy.adequate:
            chi2 = found.adequacy.chi2_reduced or 0.0
            text = f"{judgement.lack_of_fit} The model {other.name} explains them (χ²/dof = {plain(chi2, 3)})."
            return replace(judgement, lack_of_fit=text, remedied=chi2 * ALL_MISFIT < declared)
    return judgement


def _may_be_the_model(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> bool:
    """Whether the model may be at fault: not its discretisation, nor what no linear model explains."""
    findings, few = estimate.findings, judgement.adequacy.degrees_of_freedom < LEAST_FREE
    network = findings.network
    plain_fit = (
        findings.learned is None and (network is None or network.optimiser != "adam") and findings.method.is_exact
    )
    return evidence.model.is_linear and plain_fit and not few and not judgement.overtones


def _tried(evidence: Evidence, judgement: Judgement) -> list[SensorModel]:
    """The models worth a whole fit, those of fewest parameters first."""
    likely: dict[str, SensorModel] = {}
    for problem in _problems(evidence, judgement):
        likely |= {model.name: model for model in _likely(problem, _others(evidence))}
        if any(model.name.count("+") <= evidence.model.name.count("+") + 1 for model in likely.values()):
            break
    return sorted(likely.values(), key=lambda model: len(model.parameter_names))[:MOST_TRIED]


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


def _likely(problem: FrequencyProblem, others: Sequence[SensorModel]) -> list[SensorModel]:
    """Those models that leave least of the response."""
    own = _left(problem, problem.model)
    found = [(_left(problem, other), other) for other in others]
    least = min([own / BETTER, *(cost * ALIKE for cost, _ in found)])
    return [other for cost, other in found if cost < min(max(least, WELL), 0.5 * own)]


def _left(problem: FrequencyProblem, model: SensorModel) -> float:
    """χ²/ν of a model at the points; infinite where too few degrees of freedom are left."""
    free = problem.equations - len(model.parameter_names)
    if free < LEAST_FREE:
        return np.inf
    try:
        start = find_start(replace(problem, model=model), model)
        coordinates = Coordinates.at(model, start.values, problem.band_hz)
        trace = levenberg_marquardt(problem.normal, coordinates.first, coordinates, progress=silent)
    except VibridentError:
        return np.inf
    return float(trace.costs[-1]) / free


def _others(evidence: Evidence) -> list[SensorModel]:
    """Linear models beside the present one: of another core, and with more add-ons."""
    own, possible = evidence.model.name.split("+"), ADDED if evidence.bands is None else WITH_NETWORK
    names = ["+".join([core, *own[1:]]) for core in CORES if core != own[0]]
    names += ["+".join([*own, *more.split("+")]) for more in possible if not set(more.split("+")) & set(own)]
    models = (installed(name) for name in names)
    return [model for model in models if model is not None and model.is_linear]

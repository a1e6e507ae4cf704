"""Which model explains data that the model asked for does not."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from vibrident.base.amounts import plain
from vibrident.base.errors import VibridentError
from vibrident.fit.judge.attempts import MIN_SHARE, Fitted
from vibrident.fit.problem import Coordinates, Evidence, FrequencyProblem
from vibrident.fit.start.start import Start, extended, find_start
from vibrident.physics.models import ADD_ONS, CORES, SensorModel, installed

#: Degrees of freedom that must be left to judge a model by.
LEAST_FREE = 4
#: χ²/ν at the points alone that is little.
LITTLE = 1.5


def with_remedy(fitted: Fitted, fit_anew: Callable[[SensorModel], Fitted]) -> Fitted:
    """Return the fit, its judgement with the model that explains what its own does not, if any.

    Models are tried at the excited frequencies, from the values of the present one, and the likely
    ones by one fit from the values at the points. What is said is what a user gets who asks for
    that model: ``fit_anew`` fits it from nothing, and its χ² is stated.
    """
    evidence = fitted.evidence
    judgement = fitted.judgement
    declared = judgement.adequacy.chi2_reduced or 0.0
    if fitted.adequate or declared <= 0.0 or not _may_be_the_model(fitted):
        return fitted
    for other, values in itertools.islice(_tried(fitted), 2):
        try:
            if not fitted.once(replace(evidence, model=other, start=values)).adequate:
                continue
            better = fit_anew(other)
        except VibridentError:
            continue
        if better.adequate:
            chi2 = better.judgement.adequacy.chi2_reduced or 0.0
            explained = f"The model {other.name} explains them (χ²/dof = {plain(chi2, 3)})."
            text = f"{judgement.lack_of_fit} {explained}"
            judgement = replace(judgement, lack_of_fit=text, remedied=chi2, explained_by=other.name)
            return replace(fitted, judgement=judgement)
    return fitted


def _may_be_the_model(found: Fitted) -> bool:
    """Whether the model may be at fault: not its discretisation, nor what no linear model explains."""
    findings = found.estimate.findings
    few = found.judgement.adequacy.degrees_of_freedom < LEAST_FREE
    network = findings.network
    plain_fit = (
        findings.learned is None
        and (network is None or network.optimiser != "adam")
        and findings.method.is_exact
    )
    if found.evidence.bands is not None:
        few |= found.judgement.explained < MIN_SHARE
    return found.evidence.model.is_linear and plain_fit and not few


def _tried(found: Fitted) -> Iterator[tuple[SensorModel, dict[str, float]]]:
    """The models worth a fit of the records, with their values at the points: those of fewest parameters come first."""
    problem = found.evidence.first_look
    if problem is None:
        return
    if not problem.polar:  # beside the fit
        problem = replace(problem, data=found.judgement.adequacy.as_data)
    own = (found.judgement.adequacy.chi2_reduced or 0.0, found.evidence.model, found.values)
    for level in _others(found.evidence):
        likely = itertools.chain.from_iterable(_likely(problem, alike, *own) for alike in level)
        first = next(likely, None)
        if first is not None:
            yield first
            yield from likely
            return


def _likely(
    problem: FrequencyProblem,
    others: Sequence[SensorModel],
    own: float,
    model: SensorModel,
    values: dict[str, float],
) -> Iterator[tuple[SensorModel, dict[str, float]]]:
    """Models that leave a tenth of χ²/ν or less, or little; and no more than 30 times what the best one leaves."""
    found = []
    worth = min(max(own / 10.0, LITTLE), 0.5 * own)
    for other in others:
        free = problem.equations - len(other.parameter_names)
        start = _start(problem, other, model, values, worth * free) if free >= LEAST_FREE else None
        if start is not None and _inside(problem, other, start.values):
            found.append((other, start.costs[-1] / free, start.values))
    least = min([own / 10.0, *(30.0 * cost for _, cost, _ in found)])
    for other, cost, there in found:
        if cost < min(max(least, LITTLE), worth):
            yield other, there


def _start(
    problem: FrequencyProblem,
    other: SensorModel,
    model: SensorModel,
    values: dict[str, float],
    most: float,
) -> Start | None:
    """A model at the points; of one that extends the present model, from there; None where its cost is above most."""
    asked = replace(problem, model=other, start=None)
    try:
        if set(model.parameter_names) < set(other.parameter_names):
            return extended(asked, other, values, most)
        return find_start(asked, other, most)
    except VibridentError:
        return None


def _inside(problem: FrequencyProblem, other: SensorModel, values: dict[str, float]) -> bool:
    """Whether no frequency is at the end of the range searched: out there it explains nothing."""
    coordinates = Coordinates.at(other, values, problem.band_hz)
    z, (low, high) = coordinates.first, coordinates.edges
    return all(
        low[k] < z[k] < high[k] for k, spec in enumerate(other.parameters) if spec.kind == "log"
    )


def _others(evidence: Evidence) -> Iterator[list[list[SensorModel]]]:
    """Linear models of another core or with one more add-on; then those with one more and a delay.

    Of either those with as many parameters together, the fewest first.
    """
    own = evidence.model.name.split("+")
    possible = [addon for addon in ADD_ONS.values() if addon.force is None]
    if evidence.bands is not None:  # broadband motion needs a network
        possible = [addon for addon in possible if addon.factor is None]
    more = [addon.name for addon in possible if addon.name not in own]
    delays = [addon.name for addon in possible if addon.is_delay and addon.name in more]
    # a gain alone is a limit of the other cores
    cores = [name for name, core in CORES.items() if name != own[0] and len(core.parameters) > 1]
    one = [[core, *own[1:]] for core in cores] + [[*own, name] for name in more]
    two = [[*own, name, delay] for delay in delays for name in more if not ADD_ONS[name].is_delay]
    for names in (one, two):
        models = (installed("+".join(parts)) for parts in names)
        linear = [model for model in models if model is not None and model.is_linear]
        yield [
            [m for m in linear if len(m.parameters) == n]
            for n in sorted({len(m.parameters) for m in linear})
        ]

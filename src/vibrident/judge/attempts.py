"""Fit and judge; if the model is rejected, fit again from other starts, or without records that seem dead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.errors import InputError, NotConverged
from vibrident.estimators import Estimate, Estimator
from vibrident.estimators.canonical import in_one_form
from vibrident.estimators.optimise import Progress, silent
from vibrident.estimators.start import find_start
from vibrident.judge.adequacy import Judgement, judge_records, judge_table
from vibrident.judge.doubts import linearised
from vibrident.judge.effects import allowing_for_effects
from vibrident.measure import Finding
from vibrident.memory import give_back_after
from vibrident.problem import Evidence, FrequencyProblem
from vibrident.problem.frequency_domain import response_residual
from vibrident.records import FloatArray
from vibrident.uncertainty.adequacy import looks_random
from vibrident.uncertainty.linearised import Linearised

#: Number of other starts tried if the model is rejected.
MORE_STARTS = 2
#: Their cost is at most so many times that of the best start.
COMPARABLE = 10.0
#: Another fit is taken if its χ² is less than this part of the first one's.
CLEARLY_LESS = 0.8
#: Other starts of an adequate fit that is not the optimum in the noise found: their cost is larger by this at most, …
NO_WORSE = 25.0
#: … and their χ² by this.
ALIKE = 9.0
#: Largest number of searches in the response that the network's residual shows.
SEARCHES = 3
#: A frequency that ran to the end of the range searched starts once more so many times outside the band of the data.
OUTSIDE = 3.0
#: Records that seem dead are left out where the model explains the others so many times better.
MUCH_BETTER = 4.0
#: Rounds in which the scatter of a table's phase settles to this part of it, and what its record says then.
PHASE_ROUNDS, PHASE_SETTLED = 20, 0.01
PHASE_BY_SCATTER = "the phase's uncertainty, which the table does not state, by its scatter"


@dataclass(frozen=True, eq=False)
class Fitted:
    """A calibration with its estimate, before anything is stated of it.

    Attributes:
        evidence: the data, without drift where there was one.
        estimate: the fit.
        judgement: what the estimate says of the data.
        linear: the fit at all excited frequencies, linearised at the estimate.
        estimator: that made it.
        reason: why that one.
        drifts: what was taken out.
    """

    evidence: Evidence
    estimate: Estimate
    judgement: Judgement
    linear: Linearised
    estimator: Estimator
    reason: str
    drifts: tuple[Finding, ...] = ()

    def at(self, estimate: Estimate) -> Fitted:
        """The same data judged at another estimate."""
        judgement = judged(self.evidence, estimate)
        linear = linearised(self.evidence, estimate, judgement)
        return replace(self, estimate=estimate, judgement=judgement, linear=linear)

    def again(self, values: Mapping[str, float], progress: Progress = silent) -> Fitted:
        """The same data fitted once more, from these values of the parameters."""
        return self.at(fitted_and_judged(replace(self.evidence, start=dict(values)), self.estimator, progress)[0])


def fitted_and_judged(evidence: Evidence, estimator: Estimator, progress: Progress) -> tuple[Estimate, Judgement]:
    """The fit from the start values; where it explains nothing, the best from the other optima that their search met.

    Raises:
        NotConverged: the start values lead to no finite fit.
    """
    best = _once(evidence, estimator, progress)
    begin = best[0].begin
    if best[1].adequacy.adequate and begin is not None and evidence.model.is_linear:
        best = _better_weighted(evidence, estimator, best, progress)
    if best[1].adequacy.adequate or begin is None or evidence.bands is None:
        return best  # tones are searched with the residual that is fitted: no other start is better
    best = _searched_again(evidence, estimator, best, progress)
    for start, cost in begin.others[:MORE_STARTS]:
        if cost > COMPARABLE * begin.costs[-1] or best[1].adequacy.adequate:
            break
        best = _tried(start, evidence, estimator, best, progress)
    start = _back_inside(best[0], evidence)
    if start is not None and not best[1].adequacy.adequate:
        best = _tried(start, evidence, estimator, best, progress)
    return best


def _better_weighted(
    evidence: Evidence, estimator: Estimator, best: tuple[Estimate, Judgement], progress: Progress
) -> tuple[Estimate, Judgement]:
    """A fit from another optimum of the start, where the first did not reach its optimum in the noise that was found.

    Such a fit, of equal weights, is drawn aside by noise of the reference, or has followed a line of the noise.
    """
    begin = best[0].begin
    if _noise_weights(best[0]) != "white" or begin is None:
        return best
    least, first = _chi2(best[1]) + ALIKE, best
    for start, cost in begin.others[:MORE_STARTS]:
        if cost > begin.costs[-1] + NO_WORSE:
            break
        try:
            other = _once(replace(evidence, start=dict(start)), estimator, progress)
        except (NotConverged, InputError):
            continue
        reached = _noise_weights(other[0]) == "spectrum" and other[1].adequacy.adequate
        if reached and _chi2(other[1]) < least:
            least, first = _chi2(other[1]), other
    return first


def _noise_weights(estimate: Estimate) -> str:
    """By what the lines of the residual count; empty without a network."""
    network = estimate.findings.network
    return "" if network is None else network.weights


def _chi2(judgement: Judgement) -> float:
    return float(judgement.adequacy.chi2_reduced or 0.0) * judgement.adequacy.degrees_of_freedom


def with_phase_scatter(
    evidence: Evidence, estimator: Estimator, found: tuple[Estimate, Judgement], progress: Progress
) -> tuple[Evidence, Estimate, Judgement]:
    """The fit of a table that states the magnitude's uncertainty alone: that of the phase is seen in its deviations.

    It is taken in proportion to the magnitude's. Where the deviations follow a pattern, the model does not explain the
    phase, and their size says nothing of its uncertainty.
    """
    table, problem, now = evidence.calibration.table, evidence.first_look, evidence
    if table is None or problem is None or not problem.has_phase:
        return now, *found
    if table.magnitude_uncertainty is None or table.phase_uncertainty_rad is not None:
        return now, *found
    free, order = table.points - 0.5 * len(found[0].z), np.argsort(table.frequency_hz, kind="stable")
    history = (*table.provenance.history, PHASE_BY_SCATTER)
    begin, known = found, 1.0
    for _ in range(PHASE_ROUNDS if free > 1.0 else 0):
        args = (found[0].coordinates, problem.polar, problem.has_phase, evidence.quantity, problem.data)
        turn = np.asarray(response_residual(found[0].z, *args))[table.points :][order]
        scatter = float(np.sqrt(np.sum(turn**2) / free))
        if abs(scatter - known) < PHASE_SETTLED * known or scatter == 0.0:
            return (now, *found) if looks_random(turn) else (evidence, *begin)
        known, stated = scatter, scatter * problem.relative_deviation
        told = replace(table, phase_uncertainty_rad=stated, provenance=replace(table.provenance, history=history))
        now = Evidence.gather(replace(evidence.calibration, table=told), evidence.model)
        found = fitted_and_judged(now, estimator, progress)
    return evidence, *begin


def without_dead_records(
    evidence: Evidence, judgement: Judgement, chosen: Estimator, progress: Progress
) -> tuple[Evidence, Estimate, Judgement] | None:
    """The fit without records that seem dead, where the model explains the others so much better."""
    others = evidence.without_dead_records()
    if others is None:
        return None
    estimate, better = fitted_and_judged(others, chosen, progress)
    chi2 = [judged.adequacy.chi2_reduced or np.inf for judged in (better, judgement)]
    # A dead record of little noise may draw the whole fit to itself, and leave the others as noise.
    kept = [index for index, record in enumerate(evidence.records) if any(record is other for other in others.records)]
    left = _unexplained(others, better.predicted), _unexplained(others, [judgement.predicted[i] for i in kept])
    spoilt = chi2[0] < chi2[1] / MUCH_BETTER or left[0] < left[1] / MUCH_BETTER
    return (others, estimate, better) if spoilt else None


def _unexplained(evidence: Evidence, predicted: Sequence[FloatArray]) -> float:
    """Mean square of the responses' deviations from the prediction, each over its response's."""
    parts = []
    for record, expected in zip(evidence.records, predicted, strict=True):
        used = record.mask & np.isfinite(expected)
        parts.append(float(np.var((record.response - expected)[used]) / np.var(record.response[used])))
    return float(np.mean(parts))


def _tried(
    start: Mapping[str, float],
    evidence: Evidence,
    estimator: Estimator,
    best: tuple[Estimate, Judgement],
    progress: Progress,
) -> tuple[Estimate, Judgement]:
    """The fit from another start if it is better, else the best so far.

    A start may lead to no fit: a delay beyond the record, for one.
    """
    begun = replace(evidence, start=dict(start))
    try:
        if not estimator.promises(begun, best[0], progress):
            return best
        other = _once(begun, estimator, progress)
    except (NotConverged, InputError):
        return best
    less = (other[1].adequacy.chi2_reduced or np.inf) < CLEARLY_LESS * (best[1].adequacy.chi2_reduced or 0.0)
    return other if less else best


def _searched_again(
    evidence: Evidence, estimator: Estimator, best: tuple[Estimate, Judgement], progress: Progress
) -> tuple[Estimate, Judgement]:
    """The fit from a search in the response as the network's residual shows it, where that leads to a better one.

    Free motion and what leaks over from other frequencies, which hide the response that the first search had, are gone
    from it.
    """
    for _ in range(SEARCHES):
        points, model = best[1].adequacy, evidence.model
        if points.adequate or not model.is_linear or len(points.frequency_hz) <= len(best[0].z):
            break
        size = np.abs(points.measured)
        data = (points.frequency_hz, np.ones(len(size), complex), points.measured, points.relative_deviation * size)
        problem = FrequencyProblem(model, evidence.quantity, False, True, data)
        try:
            begin = find_start(problem, model)
        except (NotConverged, InputError):
            break
        here = response_residual(best[0].z, best[0].coordinates, False, True, evidence.quantity, data)
        if not begin.costs[-1] < CLEARLY_LESS * float(np.sum(np.square(here))):
            break
        other = _tried(begin.values, evidence, estimator, best, progress)
        if other is best:
            break
        best = other
    return best


def _back_inside(estimate: Estimate, evidence: Evidence) -> dict[str, float] | None:
    """The estimate with frequencies at the end of their range brought near the band: out there nothing leads back."""
    coordinates = estimate.coordinates
    values, (low, high) = coordinates.values(estimate.z), coordinates.edges
    moved = dict(values)
    for index, spec in enumerate(coordinates.model.parameters):
        if spec.kind == "log" and not low[index] < estimate.z[index] < high[index]:
            above = estimate.z[index] >= high[index]
            moved[spec.name] = OUTSIDE * evidence.band_hz[1] if above else evidence.band_hz[0] / OUTSIDE
    return moved if moved != values else None


def judged(evidence: Evidence, estimate: Estimate) -> Judgement:
    """What the estimate says of the data."""
    judge = judge_table if evidence.calibration.table else judge_records
    return allowing_for_effects(evidence, estimate, judge(evidence, estimate))


def _once(evidence: Evidence, estimator: Estimator, progress: Progress) -> tuple[Estimate, Judgement]:
    longest = max((record.samples for record in evidence.records), default=0)
    give_back_after(longest)
    found = estimator.fit(evidence, progress)
    found = found if found.problem is None else replace(found, problem=found.problem.idle())
    give_back_after(longest)
    estimate = in_one_form(found)
    judgement = judged(evidence, estimate)
    give_back_after(longest)
    if judgement.adequacy.adequate or (other := estimator.where_rejected(evidence, found, progress)) is None:
        return estimate, judgement
    estimate = in_one_form(other)
    return estimate, judged(evidence, estimate)

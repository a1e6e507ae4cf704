"""Fit and judge; if the model is rejected, fit again from other starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import InputError, NotConverged
from vibrident.base.memory import give_back_after
from vibrident.data.records import FloatArray
from vibrident.fit.descent.optimise import Progress, silent
from vibrident.fit.estimators import Estimate, Estimator
from vibrident.fit.estimators.canonical import canonically_labelled
from vibrident.fit.judge.adequacy import Judgement, judge_decays, judge_records, judge_table
from vibrident.fit.judge.effects import allowing_for_effects
from vibrident.fit.judge.examined import Examined, Told
from vibrident.fit.judge.points import linearised
from vibrident.fit.problem import Evidence, FrequencyProblem
from vibrident.fit.response.explained import MOST_LEFT, part_left
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.start.search import LONGEST, LogCoordinates
from vibrident.fit.start.start import find_start
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.fit.uncertainty.parameters import weakly_determined

#: Another fit is taken if its χ² is less than this part of the first one's.
CLEARLY_LESS = 0.8
#: Other starts of an adequate fit that is not the optimum in the noise found: so many, …
MORE_STARTS = 2
#: … whose cost is larger by this at most, five standard deviations of one parameter, …
NO_WORSE = 25.0
#: … and their χ² by this, three of them.
ALIKE = 9.0
#: Largest number of searches in the response that the network's residual shows.
SEARCHES = 3
#: A frequency that ran to the end of the range searched starts once more so many times outside the band of the data.
OUTSIDE = 3.0


@dataclass(frozen=True, eq=False)
class Attempt:
    """Data, the estimate from them, what it says of them, and how it was made; as :class:`Fitted` has them."""

    evidence: Evidence
    estimate: Estimate
    judgement: Judgement
    estimator: Estimator
    progress: Progress
    told: tuple[Told, ...] = ()
    phase_by_scatter: bool = False
    examined: Examined | None = None

    @classmethod
    def at(cls, evidence: Evidence, estimator: Estimator, progress: Progress) -> Attempt:
        """The fit from the start values; where it explains nothing, the best from a search with what it showed.

        Raises:
            NotConverged: the start values lead to no finite fit.
        """
        best = cls(evidence, *_once(evidence, estimator, progress), estimator, progress)
        begin = best.estimate.begin
        if best.adequate and begin is not None and evidence.model.is_linear and not _weak(best.estimate):
            best = _better_weighted(best)  # what the data do not determine no other start does
        if best.adequate or begin is None or evidence.bands is None:
            return best  # tones are searched with the residual that is fitted: no other start is better
        found = _searched_again(best)
        if found is None or _back_inside(found) is not None:
            # Too few points to search in, or noise of the reference leads the search to the end of its range.
            weighed = _weighed_start(best)
            best = best if weighed is None else _tried(weighed, best)
        else:
            best = found
        start = _back_inside(best)
        return best if start is None or best.adequate else _tried(start, best)

    def anew(self, evidence: Evidence) -> Attempt:
        """The same estimator's of other data, from where this fit stands."""
        start = self.estimate.coordinates.values(self.estimate.z)
        found = Attempt.at(replace(evidence, start=start), self.estimator, self.progress)
        found = replace(found, evidence=evidence)
        return replace(found, told=self.told, phase_by_scatter=self.phase_by_scatter)

    def afresh(self, evidence: Evidence) -> Attempt:
        """The same estimator's of other data, from start values of their own."""
        return Attempt.at(evidence, self.estimator, self.progress)

    def once(self, evidence: Evidence) -> Attempt:
        """The same estimator's of other data, by a single fit from their start values."""
        estimate, judgement = _once(evidence, self.estimator, self.progress)
        return replace(self, evidence=evidence, estimate=estimate, judgement=judgement, examined=None)

    def begun_at(self, start: Mapping[str, float]) -> Attempt:
        """The same data fitted once, from other start values."""
        return replace(self.once(replace(self.evidence, start=dict(start))), evidence=self.evidence)

    @property
    def adequate(self) -> bool:
        """Whether the model explains the data."""
        return self.judgement.adequacy.adequate

    @property
    def in_noise_found(self) -> bool:
        """Whether the fit is the optimum in the noise that it found."""
        return _noise_weights(self.estimate) == "spectrum"


@dataclass(frozen=True, eq=False)
class Fitted:
    """A calibration with its estimate, before anything is stated of it.

    Attributes:
        evidence: the data.
        estimate: the fit.
        judgement: what the estimate says of the data.
        linear: the fit at all excited frequencies, linearised at the estimate.
        estimator: that made it.
        reason: why that one.
        told: departures that the fit has as nuisance parameters.
        phase_by_scatter: whether the uncertainty of a table's phase was read from its deviations.
        examined: what departs from the estimate; None where that was not asked yet.
    """

    evidence: Evidence
    estimate: Estimate
    judgement: Judgement
    linear: Linearised
    estimator: Estimator
    reason: str
    told: tuple[Told, ...] = ()
    phase_by_scatter: bool = False
    examined: Examined | None = None

    def at(self, estimate: Estimate) -> Fitted:
        """The same data judged at another estimate."""
        judgement = judged(self.evidence, estimate)
        linear = linearised(self.evidence, estimate, judgement)
        return replace(self, estimate=estimate, judgement=judgement, linear=linear, examined=None)

    def again(self, values: Mapping[str, float], progress: Progress = silent) -> Fitted:
        """The same data fitted once more, from these values of the parameters."""
        return self.at(Attempt.at(replace(self.evidence, start=dict(values)), self.estimator, progress).estimate)


def _better_weighted(best: Attempt) -> Attempt:
    """A fit from another optimum of the start, where the first did not reach its optimum in the noise that was found.

    Or where it reached the end of the range searched.

    Such a fit, of equal weights, is drawn aside by noise of the reference, or has followed a line of the noise.
    """
    begin, weights = best.estimate.begin, _noise_weights(best.estimate)
    settled = weights != "white" and (weights != "spectrum" or _back_inside(best) is None)
    if settled or begin is None:
        return best
    least, first = _chi2(best.judgement) + ALIKE, best
    starts = [start for start, cost in begin.others[:MORE_STARTS] if cost <= begin.costs[-1] + NO_WORSE]
    weighed = _weighed_start(best)
    for start in starts if weighed is None else [weighed, *starts]:
        try:
            other = best.begun_at(start)
        except (NotConverged, InputError):
            continue
        reached = _noise_weights(other.estimate) == "spectrum" and other.adequate
        if reached and _chi2(other.judgement) < least:
            least, first = _chi2(other.judgement), other
    return first


def _weak(estimate: Estimate) -> bool:
    """Whether a parameter is hardly determined."""
    return bool(weakly_determined(estimate.coordinates, estimate.z, estimate.covariance)[0])


def _noise_weights(estimate: Estimate) -> str:
    """By what the lines of the residual count; empty without a network."""
    network = estimate.findings.network
    return "" if network is None else network.weights


def _chi2(judgement: Judgement) -> float:
    return float(judgement.adequacy.chi2_reduced or 0.0) * judgement.adequacy.degrees_of_freedom


def _tried(start: Mapping[str, float], best: Attempt) -> Attempt:
    """The fit from another start if it is better, else the best so far.

    A start that is near the first one leads where that did. A start may lead to no fit: a delay beyond the record, for
    one. A fit that predicts less of the response is tested in fewer bands, and meets those that are left the better.
    """
    if _leads_alike(best, start):
        return best
    evidence, estimator = replace(best.evidence, start=dict(start)), best.estimator
    try:
        estimate, judgement = _once(evidence, estimator, best.progress)
    except (NotConverged, InputError):
        return best
    before, after = (one.adequacy.chi2_reduced for one in (best.judgement, judgement))
    lost = part_left(evidence.records, judgement.predicted) > MOST_LEFT
    if lost or not (after or np.inf) < CLEARLY_LESS * (before or 0.0):
        return best
    return replace(best, estimate=estimate, judgement=judgement, examined=None)


def _leads_alike(best: Attempt, start: Mapping[str, float]) -> bool:
    """Whether the fit began within one step of the search of this start."""
    model, evidence, begin = best.evidence.model.linear, best.evidence, best.estimate.begin
    if begin is None:
        return False
    band = np.array(evidence.band_hz)
    chart = LogCoordinates(model, evidence.quantity, band, 1.0 / (2.0 * np.pi * band[1]))
    (first, sign), (other, other_sign) = chart.place(begin.values), chart.place(dict(start))
    return sign == other_sign and bool(np.max(np.abs(first - other)) < LONGEST)


def _weighed_start(found: Attempt) -> Mapping[str, float] | None:
    """Start values by a search with the noise of the bands as the model that was found shows it, if they are better.

    Where the reference holds little but noise of its own, Σ Y X*/Σ |X|² is drawn to zero, and its own scatter is small.
    What the model leaves of the response there is as large as that noise.
    """
    evidence, z, coordinates = found.evidence, found.estimate.z, found.estimate.coordinates
    model, values = evidence.model, coordinates.values(z)

    def response(frequency_hz: FloatArray) -> ComplexArray:
        return np.asarray(model.frequency_response(values, frequency_hz, evidence.quantity), dtype=complex)

    look = None if evidence.bands is None or not model.is_linear else evidence.look(response)
    if look is None:
        return None
    try:
        begin = find_start(look, model)
    except (NotConverged, InputError):
        return None
    here = look.residual(z, coordinates)
    return begin.values if begin.costs[-1] < float(here @ here) else None


def _searched_again(best: Attempt) -> Attempt | None:
    """The fit from a search in the response as the network's residual shows it, where that leads to a better one.

    Free motion and what leaks over from other frequencies, which hide the response that the first search had, are gone
    from it. None where it has too few points to search in.
    """
    evidence, model = best.evidence, best.evidence.model
    if not model.is_linear or len(best.judgement.adequacy.frequency_hz) <= 2 * len(best.estimate.z):
        return None
    for _ in range(SEARCHES):
        points, estimate = best.judgement.adequacy, best.estimate
        if points.adequate:
            break
        size = np.abs(points.measured)
        data = (points.frequency_hz, np.ones(len(size), complex), points.measured, points.relative_deviation * size)
        problem = FrequencyProblem(model, evidence.quantity, data)
        here = problem.residual(estimate.z, estimate.coordinates)
        most = CLEARLY_LESS * float(np.sum(np.square(here)))
        try:
            begin = find_start(problem, model, most)
        except (NotConverged, InputError):
            break
        if not begin.costs[-1] < most:
            break
        other = _tried(begin.values, best)
        if other is best:
            break
        best = other
    return best


def _back_inside(found: Attempt) -> dict[str, float] | None:
    """The estimate with frequencies at the end of their range brought near the band: out there nothing leads back."""
    evidence, z, coordinates = found.evidence, found.estimate.z, found.estimate.coordinates
    values, (low, high) = coordinates.values(z), coordinates.edges
    moved = dict(values)
    for index, spec in enumerate(coordinates.model.parameters):
        if spec.kind == "log" and not low[index] < z[index] < high[index]:
            above = z[index] >= high[index]
            moved[spec.name] = OUTSIDE * evidence.band_hz[1] if above else evidence.band_hz[0] / OUTSIDE
    return moved if moved != values else None


def judged(evidence: Evidence, estimate: Estimate) -> Judgement:
    """What the estimate says of the data."""
    judge = judge_table if evidence.calibration.table else judge_records
    judge = judge if estimate.findings.decays is None else judge_decays
    return allowing_for_effects(evidence, estimate, judge(evidence, estimate))


def _once(evidence: Evidence, estimator: Estimator, progress: Progress) -> tuple[Estimate, Judgement]:
    """An estimate, or what takes its place where it is rejected, and what that says of the data."""
    give_back_after(_longest(evidence))
    found = estimator.fit(evidence, progress)
    found = found if found.problem is None else replace(found, problem=found.problem.idle())
    give_back_after(_longest(evidence))
    estimate = canonically_labelled(found)
    judgement = judged(evidence, estimate)
    give_back_after(_longest(evidence))
    if judgement.adequacy.adequate or (other := estimator.where_rejected(evidence, found, progress)) is None:
        return estimate, judgement
    estimate = canonically_labelled(other)
    return estimate, judged(evidence, estimate)


def _longest(evidence: Evidence) -> int:
    return max((record.samples for record in evidence.records), default=0)

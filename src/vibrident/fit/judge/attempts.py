"""Fit and judge; if the model is rejected, fit again from other starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vibrident.base.errors import InputError, NotConverged
from vibrident.base.memory import give_back_after
from vibrident.data.records import FloatArray, SystematicEffect
from vibrident.fit.departures.examination import Together
from vibrident.fit.estimators import Estimate, Estimator
from vibrident.fit.estimators.canonical import canonically_labelled
from vibrident.fit.judge.adequacy import Judgement, judge_decays, judge_records, judge_table
from vibrident.fit.judge.effects import all_effects, allowing_for_effects, linearised
from vibrident.fit.optimise import Progress
from vibrident.fit.problem import Evidence, FrequencyProblem
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.start.search import LONGEST, LogCoordinates
from vibrident.fit.start.start import Start, find_start
from vibrident.fit.uncertainty.alternatives import ALIKE
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.fit.uncertainty.parameters import weakly_determined
from vibrident.result import Finding, ResultWarning

#: Another fit is taken if its χ² is less than this part of the first one's …
CLEARLY_LESS = 0.8
#: … and if it explains this share of the response's power.
MIN_SHARE = 0.5


@dataclass(frozen=True)
class Told:
    """What is said of departures."""

    findings: tuple[Finding, ...] = ()
    warnings: tuple[ResultWarning, ...] = ()


@dataclass(frozen=True, eq=False)
class Fitted:
    """A calibration with its estimate, before anything is stated of it.

    Attributes:
        evidence: the data.
        estimate: the fit.
        judgement: what the estimate says of the data.
        estimator: that made it.
        progress: called after each iteration of its optimiser.
        reason: why that estimator.
        told: departures that the fit has as nuisance parameters.
        phase_by_scatter: whether the uncertainty of a table's phase was read from its deviations.
        departures: from the estimate, the most significant kind first; None where that was not asked yet.
    """

    evidence: Evidence
    estimate: Estimate
    judgement: Judgement
    estimator: Estimator
    progress: Progress
    reason: str = ""
    told: tuple[Told, ...] = ()
    phase_by_scatter: bool = False
    departures: tuple[Together, ...] | None = None

    @classmethod
    def of(cls, evidence: Evidence, estimator: Estimator, progress: Progress) -> Fitted:
        """The fit from the start values; where it explains nothing, the best from a search with what it showed.

        Raises:
            NotConverged: the start values lead to no finite fit.
        """
        return _or_another(cls._searched(evidence, estimator, progress))

    @classmethod
    def _searched(cls, evidence: Evidence, estimator: Estimator, progress: Progress) -> Fitted:
        """Return the fit from the start values, or from a search with what that showed."""
        best = cls(evidence, *_once(evidence, estimator, progress), estimator, progress)
        begin = best.estimate.begin
        if best.adequate and begin is not None and evidence.model.is_linear and not _weak(best.estimate):
            best = _better_weighted(best, begin)  # what the data do not determine no other start does
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

    def anew(self, evidence: Evidence, start: Mapping[str, float] | None = None) -> Fitted:
        """The same estimator's of other data, from these values or from where this fit stands."""
        values = self.values if start is None else dict(start)
        found = Fitted.of(replace(evidence, start=values), self.estimator, self.progress)
        kept = {"reason": self.reason, "told": self.told, "phase_by_scatter": self.phase_by_scatter}
        return replace(found, evidence=evidence, **kept)

    def once(self, evidence: Evidence) -> Fitted:
        """The same estimator's of other data, by a single fit from their start values."""
        estimate, judgement = _once(evidence, self.estimator, self.progress)
        return replace(self, evidence=evidence, estimate=estimate, judgement=judgement, departures=None)

    def begun_at(self, start: Mapping[str, float]) -> Fitted:
        """The same data fitted once, from other start values."""
        return replace(self.once(replace(self.evidence, start=dict(start))), evidence=self.evidence)

    def at(self, estimate: Estimate) -> Fitted:
        """The same data judged at another estimate."""
        return replace(self, estimate=estimate, judgement=judged(self.evidence, estimate), departures=None)

    def with_evidence(self, evidence: Evidence) -> Fitted:
        """Return the same estimate judged by evidence with other effects or findings."""
        return replace(self, evidence=evidence, judgement=judged(evidence, self.estimate))

    @property
    def adequate(self) -> bool:
        """Whether the model explains the data."""
        return self.judgement.adequacy.adequate

    @property
    def chi2(self) -> float:
        """χ² of the adequacy test."""
        return _chi2(self)

    @property
    def in_noise_found(self) -> bool:
        """Whether the fit is the optimum in the noise that it found."""
        return _noise_weights(self) == "spectrum"

    @property
    def values(self) -> dict[str, float]:
        """The parameters by name."""
        return self.estimate.coordinates.values(self.estimate.z)

    @cached_property
    def linear(self) -> Linearised:
        """The fit at all excited frequencies, linearised at the estimate."""
        return linearised(self.evidence, self.estimate, self.judgement)

    @property
    def effects(self) -> list[SystematicEffect]:
        """Systematic effects as stated, and those that were found in the data."""
        return all_effects(self.evidence, self.judgement)


def judged(evidence: Evidence, estimate: Estimate) -> Judgement:
    """What the estimate says of the data."""
    judge = judge_table if evidence.calibration.table else judge_records
    judge = judge if estimate.findings.decays is None else judge_decays
    return allowing_for_effects(evidence, estimate, judge(evidence, estimate))


def _once(evidence: Evidence, estimator: Estimator, progress: Progress) -> tuple[Estimate, Judgement]:
    """An estimate, or what takes its place where it is rejected, and what that says of the data."""
    longest = max((record.samples for record in evidence.records), default=0)
    give_back_after(longest)
    found = estimator.fit(evidence, progress)
    found = found if found.problem is None else replace(found, problem=found.problem.idle())
    give_back_after(longest)
    estimate = canonically_labelled(found)
    judgement = judged(evidence, estimate)
    give_back_after(longest)
    if judgement.adequacy.adequate or (other := estimator.where_rejected(evidence, found, progress)) is None:
        return estimate, judgement
    estimate = canonically_labelled(other)
    return estimate, judged(evidence, estimate)


def _or_another(best: Fitted) -> Fitted:
    """Return a fit, or another estimate where that is rejected and the other is not."""
    if best.adequate or best.evidence.calibration.table is not None:
        return best
    try:
        other = best.estimator.another(best.evidence, best.progress)
    except (NotConverged, InputError, np.linalg.LinAlgError):
        return best
    tried = best if other is None else best.at(canonically_labelled(other))
    return tried if tried.adequate else best


def _weak(estimate: Estimate) -> bool:
    """Whether a parameter is hardly determined."""
    return bool(weakly_determined(estimate.coordinates, estimate.z, estimate.covariance)[0])


def _better_weighted(best: Fitted, begin: Start) -> Fitted:
    """A fit from another optimum of the start, where the first did not reach its optimum in the noise that was found.

    Or where it reached the end of the range searched. Such a fit, of equal weights, is drawn aside by noise of the
    reference, or has followed a line of the noise.
    """
    weights = _noise_weights(best)
    if weights != "white" and (weights != "spectrum" or _back_inside(best) is None):
        return best
    weighed = _weighed_start(best)
    # Two others at most, whose cost is larger by no more than five standard deviations of one parameter.
    starts = [start for start, cost in begin.others[:2] if cost <= begin.costs[-1] + 5.0**2]
    least, first = _chi2(best) + ALIKE, best
    for start in starts if weighed is None else [weighed, *starts]:
        try:
            other = best.begun_at(start)
        except (NotConverged, InputError):
            continue
        if other.in_noise_found and other.adequate and _chi2(other) < least:
            least, first = _chi2(other), other
    return first


def _noise_weights(fitted: Fitted) -> str:
    """By what the lines of the residual count; empty without a network."""
    network = fitted.estimate.findings.network
    return "" if network is None else network.weights


def _chi2(fitted: Fitted) -> float:
    adequacy = fitted.judgement.adequacy
    return float(adequacy.chi2_reduced or 0.0) * adequacy.degrees_of_freedom


def _tried(start: Mapping[str, float], best: Fitted) -> Fitted:
    """The fit from another start if it is better, else the best so far.

    A start that is near the first one leads where that did. A start may lead to no fit: a delay beyond the record, for
    one. A fit that predicts less of the response is tested in fewer bands, and meets those that are left the better.
    """
    if _leads_alike(best, start):
        return best
    try:
        other = best.begun_at(start)
    except (NotConverged, InputError):
        return best
    before, after = (one.judgement.adequacy.chi2_reduced for one in (best, other))
    lost = other.judgement.explained < MIN_SHARE
    return best if lost or not (after or np.inf) < CLEARLY_LESS * (before or 0.0) else other


def _leads_alike(best: Fitted, start: Mapping[str, float]) -> bool:
    """Whether the fit began within one step of the search of this start."""
    model, evidence, begin = best.evidence.model.linear, best.evidence, best.estimate.begin
    if begin is None:
        return False
    band = np.array(evidence.band_hz)
    chart = LogCoordinates(model, evidence.quantity, band, 1.0 / (2.0 * np.pi * band[1]))
    (first, sign), (other, other_sign) = chart.place(begin.values), chart.place(dict(start))
    return sign == other_sign and bool(np.max(np.abs(first - other)) < LONGEST)


def _weighed_start(found: Fitted) -> Mapping[str, float] | None:
    """Start values by a search with the noise of the bands as the model that was found shows it, if they are better.

    Where the reference holds little but noise of its own, Σ Y X*/Σ |X|² is drawn to zero, and its own scatter is small.
    What the model leaves of the response there is as large as that noise.
    """
    evidence, model, values = found.evidence, found.evidence.model, found.values

    def response(frequency_hz: FloatArray) -> ComplexArray:
        return np.asarray(model.frequency_response(values, frequency_hz, evidence.quantity), dtype=complex)

    look = None if evidence.bands is None or not model.is_linear else evidence.look(response)
    return None if look is None else _better_start(look, found, 1.0)


def _searched_again(best: Fitted) -> Fitted | None:
    """The fit from a search in the response as the network's residual shows it, where that leads to a better one.

    Free motion and what leaks over from other frequencies, which hide the response that the first search had, are gone
    from it. None where it has too few points to search in.
    """
    evidence, model = best.evidence, best.evidence.model
    if not model.is_linear or len(best.judgement.adequacy.frequency_hz) <= 2 * len(best.estimate.z):
        return None
    for _ in range(3):
        if best.adequate:
            break
        data = best.judgement.adequacy.as_data
        start = _better_start(FrequencyProblem(model, evidence.quantity, data), best, CLEARLY_LESS)
        other = best if start is None else _tried(start, best)
        if other is best:
            break
        best = other
    return best


def _better_start(problem: FrequencyProblem, found: Fitted, part: float) -> Mapping[str, float] | None:
    """Start values by a search in a response, if their cost there is less than this part of the fit's."""
    estimate = found.estimate
    here = problem.residual(estimate.z, estimate.coordinates)
    most = part * float(here @ here)
    try:
        begin = find_start(problem, problem.model, most)
    except (NotConverged, InputError):
        return None
    return begin.values if begin.costs[-1] < most else None


def _back_inside(found: Fitted) -> dict[str, float] | None:
    """The estimate with frequencies at the end of their range brought near the band: out there nothing leads back."""
    evidence, z, coordinates = found.evidence, found.estimate.z, found.estimate.coordinates
    values, (low, high) = found.values, coordinates.edges
    moved = dict(values)
    for index, spec in enumerate(coordinates.model.parameters):
        if spec.kind == "log" and not low[index] < z[index] < high[index]:
            above = z[index] >= high[index]
            moved[spec.name] = 3.0 * evidence.band_hz[1] if above else evidence.band_hz[0] / 3.0
    return moved if moved != values else None

"""Fit and judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from vibrident.base.memory import give_back_after
from vibrident.data.records import SystematicEffect
from vibrident.fit.departures.examination import DepartureGroup
from vibrident.fit.estimators import Estimate, Estimator
from vibrident.fit.estimators.canonical import canonically_labelled
from vibrident.fit.judge.adequacy import Judgement, judge_decays, judge_records, judge_table
from vibrident.fit.judge.effects import all_effects, allowing_for_effects, linearised
from vibrident.fit.optimise import Progress
from vibrident.fit.problem import Evidence
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.result import Finding, ResultWarning

#: Share of the response's power that a fit explains at least, if a model may be at fault at all.
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
    departures: tuple[DepartureGroup, ...] | None = None

    @classmethod
    def of(cls, evidence: Evidence, estimator: Estimator, progress: Progress) -> Fitted:
        """Fit and judge.

        Raises:
            NotConverged: the start values lead to no finite fit.
        """
        return cls(evidence, *_once(evidence, estimator, progress), estimator, progress)

    def anew(self, evidence: Evidence, start: Mapping[str, float] | None = None) -> Fitted:
        """The same estimator's of other data, from these values or from where this fit stands."""
        values = self.values if start is None else dict(start)
        found = Fitted.of(replace(evidence, start=values), self.estimator, self.progress)
        kept = {"reason": self.reason, "told": self.told, "phase_by_scatter": self.phase_by_scatter}
        return replace(found, evidence=evidence, **kept)

    def once(self, evidence: Evidence) -> Fitted:
        """The same estimator's of other data, by a single fit from their start values."""
        estimate, judgement = _once(evidence, self.estimator, self.progress)
        return replace(
            self, evidence=evidence, estimate=estimate, judgement=judgement, departures=None
        )

    def at(self, estimate: Estimate) -> Fitted:
        """The same data judged at another estimate."""
        return replace(
            self, estimate=estimate, judgement=judged(self.evidence, estimate), departures=None
        )

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
        adequacy = self.judgement.adequacy
        return float(adequacy.chi2_reduced or 0.0) * adequacy.degrees_of_freedom

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


def _once(
    evidence: Evidence, estimator: Estimator, progress: Progress
) -> tuple[Estimate, Judgement]:
    """An estimate, or what takes its place where it is rejected, and what that says of the data."""
    longest = max((record.samples for record in evidence.records), default=0)
    give_back_after(longest)
    found = estimator.fit(evidence, progress)
    found = found if found.problem is None else replace(found, problem=found.problem.idle())
    give_back_after(longest)
    estimate = canonically_labelled(found)
    judgement = judged(evidence, estimate)
    give_back_after(longest)
    if (
        judgement.adequacy.adequate
        or (other := estimator.where_rejected(evidence, found, progress)) is None
    ):
        return estimate, judgement
    other = canonically_labelled(other)
    again = judged(evidence, other)
    if estimate.in_noise is not None and not again.adequacy.adequate:
        return estimate, judgement
    return other, again

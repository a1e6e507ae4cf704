"""The fit of a calibration, with its judgement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vibrident.base.memory import return_freed_after
from vibrident.data.records import FloatArray, SystematicEffect
from vibrident.fit.departures.examination import DepartureGroup
from vibrident.fit.estimators import Estimate, Estimator
from vibrident.fit.estimators.canonical import canonically_labelled
from vibrident.fit.judge.adequacy import Judgement, judge_decays, judge_records, judge_table
from vibrident.fit.judge.effects import all_effects, allowing_for_effects, linearised
from vibrident.fit.optimise import Progress
from vibrident.fit.problem import Evidence
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.result import Finding, ResultWarning

#: What is estimated beside a fit, by fits in turn, stays where a step is below this part of its
#: standard uncertainty.
MAX_SETTLED_STEP = 0.3


@dataclass(frozen=True)
class DepartureReport:
    """Findings of departures, and the warnings of those that matter."""

    findings: tuple[Finding, ...] = ()
    warnings: tuple[ResultWarning, ...] = ()


@dataclass(frozen=True, eq=False)
class Fitted:
    """A calibration with its estimate and judgement, before it becomes a result.

    Attributes:
        evidence: the data.
        estimate: the fit.
        judgement: of the data by the estimate.
        estimator: that made the estimate.
        progress: called after each iteration of its optimiser.
        reason: why this estimator was chosen.
        reports: of departures that the fit has as nuisance parameters.
        phase_by_scatter: whether the uncertainty of a table's phase was read from its deviations.
        departures: from the estimate, the most significant kind first; None before their tests.
    """

    evidence: Evidence
    estimate: Estimate
    judgement: Judgement
    estimator: Estimator
    progress: Progress
    reason: str = ""
    reports: tuple[DepartureReport, ...] = ()
    phase_by_scatter: bool = False
    departures: tuple[DepartureGroup, ...] | None = None

    @classmethod
    def from_evidence(cls, evidence: Evidence, estimator: Estimator, progress: Progress) -> Fitted:
        """Fit and judge; a rejected fit is tried again.

        Raises:
            NotConverged: the start values lead to no finite fit.
        """
        return cls.at_first(evidence, estimator, progress).tried_again()

    @classmethod
    def at_first(cls, evidence: Evidence, estimator: Estimator, progress: Progress) -> Fitted:
        """Fit and judge; a rejected fit is not tried again.

        Raises:
            NotConverged: the start values lead to no finite fit.
        """
        estimate = _estimated(evidence, estimator, progress)
        return cls(evidence, *_judged_estimate(evidence, estimate), estimator, progress)

    def tried_again(self) -> Fitted:
        """Return the fit, or its replacement where it is rejected.

        A rejected fit of records stays where no other place may explain more of the response. One
        in whose noise nothing is coherent is tried again, too: it may be a wrong place, in noise
        that hides the ringing of the right one.
        """
        in_noise = self.estimate.in_noise is not None
        shares = self.judgement.shares
        if self.adequate and not shares.is_incoherent:
            return self
        if in_noise and not shares.may_rise:
            return self
        estimate = self.estimator.where_rejected(self.evidence, self.estimate, self.progress)
        if estimate is None:
            return self
        estimate, judgement = _judged_estimate(self.evidence, estimate)
        if in_noise and not judgement.adequacy.adequate:
            return self
        if self.adequate and judgement.shares.is_incoherent:
            return self
        return replace(self, estimate=estimate, judgement=judgement)

    @property
    def chance(self) -> float:
        """Return the chance that noise leaves as much of the records; one where not known."""
        in_noise = self.estimate.in_noise
        return 1.0 if in_noise is None or in_noise.settled is None else in_noise.settled.chance

    def anew(self, evidence: Evidence, start: Mapping[str, float] | None = None) -> Fitted:
        """Return the same estimator's fit of other data.

        Other optima are not looked for again: they are those of this fit.

        ``start``: parameters to start from; None takes those of this fit.
        """
        values = self.values if start is None else dict(start)
        refit = Fitted.from_evidence(replace(evidence, start=values), self.estimator, self.progress)
        return replace(
            refit,
            evidence=evidence,
            estimate=replace(refit.estimate, rival_optima=self.estimate.rival_optima),
            reason=self.reason,
            reports=self.reports,
            phase_by_scatter=self.phase_by_scatter,
        )

    def once(self, evidence: Evidence) -> Fitted:
        """Return the same estimator's fit of other data, which is not tried again if rejected."""
        fitted = Fitted.at_first(evidence, self.estimator, self.progress)
        return replace(
            self,
            evidence=evidence,
            estimate=fitted.estimate,
            judgement=fitted.judgement,
            departures=None,
        )

    def at(self, estimate: Estimate) -> Fitted:
        """Return the fit of the same data judged at another estimate."""
        return replace(
            self, estimate=estimate, judgement=judged(self.evidence, estimate), departures=None
        )

    def with_evidence(self, evidence: Evidence) -> Fitted:
        """Return the same estimate judged by evidence with other effects or findings."""
        return replace(self, evidence=evidence, judgement=judged(evidence, self.estimate))

    @property
    def adequate(self) -> bool:
        """Return whether the model explains the data."""
        return self.judgement.adequacy.adequate

    @property
    def chi2(self) -> float:
        """Return χ² of the adequacy test."""
        adequacy = self.judgement.adequacy
        return float(adequacy.chi2_reduced or 0.0) * adequacy.degrees_of_freedom

    @property
    def values(self) -> dict[str, float]:
        """Return the parameters by name."""
        return self.estimate.coordinates.values(self.estimate.z)

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the model's complex sensitivity, shape (n,)."""
        return self.evidence.model.frequency_response(
            self.values, frequency_hz, self.evidence.quantity
        )

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return the lowest and highest frequency of the motion that the fit follows."""
        band_hz = self.estimate.coordinates.band_hz
        points_hz = self.judgement.adequacy.frequency_hz
        ends_hz = points_hz if points_hz.size else band_hz
        low, high = np.clip(band_hz, np.min(ends_hz), np.max(ends_hz)).tolist()
        return low, high

    @cached_property
    def linear(self) -> Linearised:
        """Return the fit at all excited frequencies, linearised at the estimate."""
        return linearised(self.evidence, self.estimate, self.judgement)

    @property
    def effects(self) -> list[SystematicEffect]:
        """Return the systematic effects, stated and detected.

        An effect that the records are corrected for has the uncertainty that remains.
        """
        effects = all_effects(self.evidence, self.judgement)
        for number, correction in enumerate(self.evidence.corrections):
            u = effects[number].standard_uncertainty * correction.uncertainty
            effects[number] = replace(effects[number], standard_uncertainty=u)
        return effects


def judged(evidence: Evidence, estimate: Estimate) -> Judgement:
    """Return the judgement of the data by the estimate, systematic effects included."""
    judge_data = judge_table if evidence.calibration.table else judge_records
    judge_data = judge_data if estimate.findings.decays is None else judge_decays
    return allowing_for_effects(evidence, estimate, judge_data(evidence, estimate))


def _estimated(evidence: Evidence, estimator: Estimator, progress: Progress) -> Estimate:
    """Return an estimate, without the transforms of its records."""
    longest = max((record.samples for record in evidence.records), default=0)
    return_freed_after(longest)
    fitted = estimator.fit(evidence, progress)
    if fitted.problem is not None:
        fitted = replace(fitted, problem=fitted.problem.idle())
    return_freed_after(longest)
    return fitted


def _judged_estimate(evidence: Evidence, fitted: Estimate) -> tuple[Estimate, Judgement]:
    """Return an estimate with its modes in order, and the judgement by it."""
    estimate = canonically_labelled(fitted)
    judgement = judged(evidence, estimate)
    return_freed_after(max((record.samples for record in evidence.records), default=0))
    return estimate, judgement

"""What departs from a fit, in words: the findings of a result, and those of them that matter as warnings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.data.records import FloatArray
from vibrident.fit.departures.examination import Found, Together, examine
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.sources import parts_of
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.adequacy import Judgement
from vibrident.fit.judge.effects import all_effects
from vibrident.fit.judge.points import linearised
from vibrident.fit.problem import Evidence
from vibrident.fit.uncertainty.budget import patterns
from vibrident.fit.uncertainty.parameters import parameter_units
from vibrident.physics.naming import in_words
from vibrident.result import Finding, ResultWarning

#: Of a model with a bent spring.
BESIDE_ITS_MIDDLE = (
    "The model has a spring that is bent alike on both sides of its rest; one that rests beside its middle, as under a "
    "static load, is not, and the parameters are off by more than their uncertainty says."
)
#: A finding matters where it moves a parameter by its stated standard uncertainty.
MATTERS = 1.0


def examined(
    evidence: Evidence, estimate: Estimate, judgement: Judgement, total: FloatArray
) -> tuple[list[Finding], list[ResultWarning]]:
    """All findings, and warnings of those that matter.

    Args:
        evidence: the data.
        estimate: the fit.
        judgement: what the estimate says of them.
        total: covariance of the coordinates as stated, systematic effects included, shape (p, p).
    """
    uncertainty = np.sqrt(np.maximum(np.diag(total), 0.0))
    tones = judgement.points[0] if judgement.tones is not None else None
    parts = parts_of(evidence, estimate, judgement.predicted, tones)
    misfit = not judgement.adequacy.adequate
    groups = examine(parts, _points(evidence, estimate, judgement), uncertainty, misfit=misfit)
    words = _Words(evidence, estimate, uncertainty)
    findings = [words.finding(one) for group in groups for one in group.found]
    unexplained = misfit and judgement.adequacy.degrees_of_freedom > 0
    matter = [
        group
        for number, group in enumerate(groups)
        if group.impact >= MATTERS or (unexplained and number == 0) or _always(evidence, group.found[0].code)
    ]
    if judgement.remedied is not None:  # what another model explains is no defect of the data
        matter = []
    return findings, [words.warning(group) for group in matter]


def _always(evidence: Evidence, code: str) -> bool:
    """Whether a finding matters though it moves no parameter to first order.

    An interferometer's light that is wrong at a harmonic is wrong at the tone, and a spring that rests beside its
    middle moves the parameters by the square of what shows it.
    """
    return code == "few_fringes" or (code == "nonlinear" and not evidence.model.is_linear)


def _points(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> PointsPart | None:
    """The response of a table or of sines; None for other motion, or where nothing is left to judge by."""
    alone = evidence.calibration.table is not None or (evidence.only_sines and estimate.criterion != "samples")
    if not alone or not evidence.model.is_linear or judgement.adequacy.degrees_of_freedom <= 0:
        return None
    points, linear = judgement.adequacy, linearised(evidence, estimate, judgement)
    size = judgement.scatter or 1.0
    linear = replace(linear, matrix=linear.matrix / size, rest=linear.rest / size, weight=linear.weight / size)
    count = len(points.record)
    common = np.zeros((0, len(linear.rest)))
    effects = all_effects(evidence, judgement)
    if effects:
        shape = patterns(effects, linear, linear.frequency_hz)
        common = (np.where(linear.is_phase[:, None], np.imag(shape), np.real(shape)) * linear.weight[:, None]).T
    values = estimate.coordinates.values(estimate.z)
    transfer = evidence.model.frequency_response(values, linear.frequency_hz[:count], "acceleration")
    freedom = [part.freedom for part in judgement.points]
    return PointsPart(
        linear,
        common,
        points.record,
        None if judgement.tones is None else judgement.tones.response,
        np.asarray(transfer, dtype=complex),
        float(1.0 / np.mean(1.0 / np.concatenate(freedom))) if freedom else np.inf,
        np.zeros((0, len(linear.rest))),
    )


@dataclass(frozen=True, eq=False)
class _Words:
    """Findings and warnings in words; ``uncertainty``: of the coordinates as stated, shape (p,)."""

    evidence: Evidence
    estimate: Estimate
    uncertainty: FloatArray

    def finding(self, one: Found) -> Finding:
        """A finding by itself."""
        coordinates, z = self.estimate.coordinates, self.estimate.z
        stated, without = coordinates.values(z), coordinates.values(z - one.score.shift)
        impact = {name: float(value - without[name]) for name, value in stated.items()}
        message = f"{_said(one)} {self._without(one.score.shift, 'it')}"
        return Finding(one.code, one.record, one.candidate.time_s, one.chance, impact, message)

    def warning(self, group: Together) -> ResultWarning:
        """One for all records of a group."""
        first, others = group.found[0], len(group.found) - 1
        text, them = _said(first), "it"
        if others:
            text = f"{text} So it is in {others} more record{'s' if others > 1 else ''}."
            them = "them"
        text = f"{text} {self._without(group.shift, them)}"
        if first.code == "nonlinear" and not self.evidence.model.is_linear:
            text += f" {BESIDE_ITS_MIDDLE}"
        return ResultWarning(first.code, text)

    def _without(self, shift: FloatArray, it: str) -> str:
        """What the parameter that moves most would be."""
        coordinates, z = self.estimate.coordinates, self.estimate.z
        size = np.abs(shift) / np.maximum(self.uncertainty, np.finfo(float).tiny)
        name = coordinates.model.parameter_names[int(np.argmax(size))]
        unit = parameter_units(self.evidence.model, self.evidence.calibration)[name]
        stated, without = coordinates.values(z)[name], coordinates.values(z - shift)[name]
        return (
            f"Without {it} the {in_words(name)} would be {amount(without, unit, 6)} in place of "
            f"{amount(stated, unit, 6)} ({plain(float(np.max(size)), 2)} u)."
        )


def _said(one: Found) -> str:
    text = one.sentence[:1].upper() + one.sentence[1:]
    text = text if text.endswith("?") else f"{text}."
    return text if one.record is None else f"{one.record}: {text}"

"""What departs from a fit, in words: the findings of a result, and those of them that matter as warnings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.data.records import FloatArray, Record
from vibrident.fit.departures.examination import Found, Together, examine
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.sources import parts_of, scale_of
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.adequacy import Judgement
from vibrident.fit.judge.effects import all_effects
from vibrident.fit.judge.points import linearised
from vibrident.fit.problem import Evidence
from vibrident.fit.screening.hum import hum_tones, lacking
from vibrident.fit.uncertainty.budget import patterns
from vibrident.fit.uncertainty.linearised import Linearised
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
#: A smaller shift, in the same unit, is rounding or next to nothing, and is not told by its number.
TOLD_FROM = 0.01


@dataclass(frozen=True)
class Told:
    """What is said of departures."""

    findings: tuple[Finding, ...] = ()
    warnings: tuple[ResultWarning, ...] = ()


@dataclass(frozen=True, eq=False)
class Examined:
    """What departs from a fit.

    Attributes:
        evidence: the data.
        estimate: the fit.
        groups: departures of one kind each, the most significant first.
    """

    evidence: Evidence
    estimate: Estimate
    groups: tuple[Together, ...]

    @classmethod
    def of(cls, evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Examined:
        """Test all departures.

        Args:
            evidence: the data.
            estimate: the fit.
            judgement: what the estimate says of them.
        """
        if estimate.findings.decays is not None:  # they have tests of their own
            return cls(evidence, estimate, ())
        tones = judgement.points[0] if judgement.tones is not None else None
        parts = parts_of(evidence, estimate, judgement.predicted, tones)
        misfit = not judgement.adequacy.adequate
        uncertainty = _deviation(estimate.covariance)
        linear = linearised(evidence, estimate, judgement)
        scale, points = scale_of(evidence, judgement.predicted, linear), _points(evidence, estimate, judgement, linear)
        groups = examine(parts, scale, points, uncertainty, misfit=misfit)
        return cls(evidence, estimate, tuple(groups))

    def beside(self, judgement: Judgement) -> tuple[Record, ...]:
        """The records with hum, and departures that can be so, as nuisance parameters.

        Themselves where they have all.
        """
        records = self.evidence.records
        if records and self.evidence.model.is_linear:
            own = tuple(record.hum_hz for record in records)
            tones, known = hum_tones(records, judgement.predicted, own), self.estimate.findings.hum_hz or own
            if lacking(tones, known, records):
                records = tuple(replace(one, hum_hz=hz) for one, hz in zip(records, tones, strict=True))
        for group in self._nuisances(judgement):  # what is shown by some is in all: it is of the channel
            freer = group.found[0].departure.beside
            records = tuple(one if one.reference is None else freer(one) for one in records)
        return records

    def told(self, judgement: Judgement, total: FloatArray) -> Told:
        """Findings of all, and warnings of those that matter.

        Args:
            judgement: of the fit.
            total: covariance of the coordinates as stated, systematic effects included, shape (p, p).
        """
        words = _Words(self.evidence, self.estimate, _deviation(total))
        # what another model explains is no defect of the data
        matter = [] if judgement.remedied is not None else self._matter(judgement, words)
        return words.told(self.groups, matter)

    def told_as_nuisance(self, judgement: Judgement) -> Told:
        """The same of those that :meth:`beside` makes nuisance parameters: the values stated are then without them."""
        words, own = replace(self._words, admitted=True), self._nuisances(judgement)
        matter = self._matter(judgement, self._words)
        return words.told(own, [group for group in own if group in matter])

    @property
    def _words(self) -> _Words:
        return _Words(self.evidence, self.estimate, _deviation(self.estimate.covariance))

    def _nuisances(self, judgement: Judgement) -> list[Together]:
        """What the fit can have as nuisance parameters; beside a tone, where they cost most, only what matters."""
        groups = self.groups if self.estimate.criterion == "samples" else self._matter(judgement, self._words)
        return [one for one in groups if one.found[0].departure.nuisance]

    def _matter(self, judgement: Judgement, words: _Words) -> list[Together]:
        unexplained = not judgement.adequacy.adequate and judgement.adequacy.degrees_of_freedom > 0
        return [
            group
            for number, group in enumerate(self.groups)
            if words.impact(group) >= MATTERS
            or (unexplained and number == 0)
            or _always(self.evidence, group.found[0].code)
        ]


def _deviation(covariance: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _always(evidence: Evidence, code: str) -> bool:
    """Whether a finding matters though it moves no parameter to first order.

    An interferometer's light that is wrong at a harmonic is wrong at the tone, and a spring that rests beside its
    middle moves the parameters by the square of what shows it.
    """
    return code == "few_fringes" or (code == "nonlinear" and not evidence.model.is_linear)


def _points(evidence: Evidence, estimate: Estimate, judgement: Judgement, linear: Linearised) -> PointsPart | None:
    """The response of a table or of sines; None for other motion, or where nothing is left to judge by."""
    alone = evidence.calibration.table is not None or (evidence.only_sines and estimate.criterion != "samples")
    if not alone or not evidence.model.is_linear or judgement.adequacy.degrees_of_freedom <= 0:
        return None
    points = judgement.adequacy
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
    """Findings and warnings in words.

    ``uncertainty``: of the coordinates as stated, shape (p,); ``admitted``: whether the fit that states the result has
    the departures as nuisance parameters, and is not this one.
    """

    evidence: Evidence
    estimate: Estimate
    uncertainty: FloatArray
    admitted: bool = False

    def told(self, groups: Sequence[Together], matter: Sequence[Together]) -> Told:
        """All findings, and the warnings."""
        findings = tuple(self.finding(one, group) for group in groups for one in group.found)
        return Told(findings, tuple(self.warning(group) for group in matter))

    def impact(self, group: Together) -> float:
        """Largest shift of a coordinate, in its stated standard uncertainty."""
        return float(np.max(self._sizes(group.shift), initial=0.0))

    def finding(self, one: Found, group: Together) -> Finding:
        """A finding by itself; one that is alone in its group moves what the group does."""
        coordinates, z = self.estimate.coordinates, self.estimate.z
        shift = group.shift if len(group.found) == 1 else one.score.shift
        stated, without = coordinates.values(z), coordinates.values(z - shift)
        impact = {name: 0.0 if self.admitted else float(value - without[name]) for name, value in stated.items()}
        message = f"{_said(one)} {self._without(one, shift, 'it')}"
        return Finding(one.code, one.record, one.candidate.time_s, one.chance, impact, message)

    def warning(self, group: Together) -> ResultWarning:
        """One for all records of a group."""
        first, others = group.found[0], len({one.record for one in group.found}) - 1
        kinds = {one.departure: one for one in reversed(group.found)}  # the most significant of each
        text = " ".join(_said(one) for one in sorted(kinds.values(), key=group.found.index))
        them = "it" if len(group.found) == 1 else "them"
        if others:
            text = f"{text} So it is in {others} more record{'s' if others > 1 else ''}."
        # beside its middle, a spring moves the parameters by the square of what shows it: to first order by nothing
        beside = first.code == "nonlinear" and not self.evidence.model.is_linear
        return ResultWarning(
            first.code, f"{text} {BESIDE_ITS_MIDDLE if beside else self._without(first, group.shift, them)}"
        )

    def _sizes(self, shift: FloatArray) -> FloatArray:
        return np.asarray(np.abs(shift) / np.maximum(self.uncertainty, np.finfo(float).tiny))

    def _without(self, one: Found, shift: FloatArray, it: str) -> str:
        """What the parameter that moves most would be."""
        coordinates, z = self.estimate.coordinates, self.estimate.z
        size = self._sizes(shift)
        name = coordinates.model.parameter_names[int(np.argmax(size))]
        unit = parameter_units(self.evidence.model, self.evidence.calibration)[name]
        stated, without = coordinates.values(z)[name], coordinates.values(z - shift)[name]
        if np.max(size) < TOLD_FROM:
            return f"No parameter moves by {TOLD_FROM:g} u."
        if one.departure.own_columns:  # the data do not tell which of them is wrong
            return f"Where it is largest, it moves the {in_words(name)} by {plain(float(np.max(size)), 2)} u."
        here, there = (stated, without) if self.admitted else (without, stated)
        digits = _digits(here, there)
        values = f"{amount(here, unit, digits)} in place of {amount(there, unit, digits)}"
        moved = f"the {in_words(name)} would be {values} ({plain(float(np.max(size)), 2)} u)."
        if self.admitted:
            return f"The fit has {it} as nuisance parameters; without these {moved}"
        return f"Without {it} {moved}"


def _digits(one: float, other: float) -> int:
    """By which two values can be told apart, to a tenth of what they differ by."""
    apart = abs(one - other) / max(abs(one), np.finfo(float).tiny)
    return min(max(6, 2 - math.floor(math.log10(apart))), 15) if apart > 0.0 else 6


def _said(one: Found) -> str:
    text = one.sentence[:1].upper() + one.sentence[1:]
    text = text if text.endswith("?") else f"{text}."
    return text if one.record is None else f"{one.record}: {text}"

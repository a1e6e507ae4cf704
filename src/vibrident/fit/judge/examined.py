"""What departs from a fit, in words: the findings of a result, and those of them that matter as warnings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.data.records import FloatArray, Record
from vibrident.fit.departures.examination import SignificantDeparture, DepartureGroup, examine
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.sources import groups_of, scale_of
from vibrident.fit.judge.attempts import Fitted, Told
from vibrident.fit.response.hum import hum_tones, lacking
from vibrident.fit.uncertainty.budget import patterns
from vibrident.fit.uncertainty.parameters import deviations, parameter_units
from vibrident.physics.naming import in_words
from vibrident.result import Finding, ResultWarning

#: Of a model with a bent spring.
BESIDE_ITS_MIDDLE = (
    "The model has a spring that is bent alike on both sides of its rest; one that rests beside its middle, as under a "
    "static load, is not, and the parameters are off by more than their uncertainty says."
)
#: A longer shift of a coordinate is beyond what a linearised fit tells: a gain twice as large, e times the frequency.
MAX_SHIFT = 1.0
#: A smaller shift, in standard uncertainties, is rounding or next to nothing, and is not told by its number.
TOLD_FROM = 0.01


def departures_of(fitted: Fitted) -> tuple[DepartureGroup, ...]:
    """All departures from a fit, tested where they were not yet; those of one kind together."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    if fitted.departures is not None:
        return fitted.departures
    if estimate.findings.decays is not None:  # they have tests of their own
        return ()
    tones = judgement.points[0] if judgement.tones is not None else None
    return tuple(
        examine(
            groups_of(evidence, estimate, judgement.predicted, tones),
            scale_of(evidence, judgement.predicted, fitted.linear),
            _points(fitted),
            deviations(estimate.covariance),
            misfit=not fitted.adequate,
        )
    )


def with_nuisances(fitted: Fitted) -> tuple[Record, ...]:
    """The records with hum, and departures that can be so, as nuisance parameters; themselves where they have all."""
    records = fitted.evidence.records
    if records and fitted.evidence.model.is_linear:
        own = tuple(record.hum_hz for record in records)
        tones = hum_tones(records, fitted.judgement.predicted, own)
        if lacking(tones, fitted.estimate.findings.hum_hz or own, records):
            records = tuple(replace(one, hum_hz=hz) for one, hz in zip(records, tones, strict=True))
    for group in _nuisances(fitted):  # what is shown by some is in all: it is of the channel
        freer = group.departures[0].departure.beside
        records = tuple(one if one.reference is None else freer(one) for one in records)
    return records


def told(fitted: Fitted, total: FloatArray) -> Told:
    """Findings of all, and warnings of those that matter.

    ``total``: covariance of the coordinates as stated, systematic effects included, shape (p, p).
    """
    groups = departures_of(fitted)
    words = _Words(replace(fitted, departures=groups), deviations(total))
    # what another model explains is no defect of the data
    matter = [] if fitted.judgement.remedied is not None else _that_matter(words)
    return Told(words.findings(groups), tuple(words.warning(group) for group in matter))


def told_as_nuisances(fitted: Fitted) -> Told:
    """The same of those that :func:`with_nuisances` gives the records: the values stated are then without them."""
    words = _words(fitted)
    own = _nuisances(fitted)
    matter = [group for group in own if group in _that_matter(words)]
    words = replace(words, admitted=True)
    return Told(words.findings(own), tuple(words.warning(group) for group in matter))


def _words(fitted: Fitted) -> _Words:
    return _Words(fitted, deviations(fitted.estimate.covariance))


def _nuisances(fitted: Fitted) -> list[DepartureGroup]:
    """What the fit can have as nuisance parameters; beside a tone, where they cost most, only what matters."""
    all_of_them = fitted.estimate.criterion == "samples"
    groups = departures_of(fitted) if all_of_them else _that_matter(_words(fitted))
    return [one for one in groups if one.found[0].departure.nuisance]


def _that_matter(words: _Words) -> list[DepartureGroup]:
    """Those that move a parameter by its standard uncertainty, the first of a misfit, and some to no first order.

    An interferometer's light that is wrong at a harmonic is wrong at the tone, and a spring that rests beside its
    middle moves the parameters by the square of what shows it.
    """
    adequacy = words.fitted.judgement.adequacy
    bent = not words.fitted.evidence.model.is_linear
    unexplained = not adequacy.adequate and adequacy.degrees_of_freedom > 0
    return [
        group
        for number, group in enumerate(departures_of(words.fitted))
        if np.max(words.sizes(group.shift), initial=0.0) >= 1.0
        or (unexplained and number == 0)
        or group.departures[0].code == "few_fringes"
        or (group.departures[0].code == "nonlinear" and bent)
    ]


def _points(fitted: Fitted) -> PointsPart | None:
    """The response of a table or of sines; None for other motion, or where nothing is left to judge by."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    linear = fitted.linear
    alone = evidence.calibration.table is not None or (
        evidence.only_sines and estimate.criterion != "samples"
    )
    if not alone or not evidence.model.is_linear or judgement.adequacy.degrees_of_freedom <= 0:
        return None
    size = judgement.scatter or 1.0
    record = judgement.adequacy.record
    linear = replace(
        linear,
        matrix=linear.matrix / size,
        residual=linear.residual / size,
        weight=linear.weight / size,
    )
    shape = patterns(fitted.effects, linear, linear.frequency_hz)
    common = (
        np.where(linear.is_phase[:, None], np.imag(shape), np.real(shape)) * linear.weight[:, None]
    )
    transfer = evidence.model.frequency_response(
        fitted.values, linear.frequency_hz[: len(record)], "acceleration"
    )
    freedom = [part.freedom for part in judgement.points]
    return PointsPart(
        linear,
        common.T,
        record,
        None if judgement.tones is None else judgement.tones.response,
        np.asarray(transfer, dtype=complex),
        float(1.0 / np.mean(1.0 / np.concatenate(freedom))) if freedom else np.inf,
        np.zeros((0, len(linear.residual))),
    )


@dataclass(frozen=True, eq=False)
class _Words:
    """Findings and warnings in words.

    ``uncertainty``: of the coordinates as stated, shape (p,); ``admitted``: whether the fit that states the result has
    the departures as nuisance parameters, and is not this one.
    """

    fitted: Fitted
    uncertainty: FloatArray
    admitted: bool = False

    def sizes(self, shift: FloatArray) -> FloatArray:
        """A shift of the coordinates, in their standard uncertainties."""
        return np.asarray(np.abs(shift) / np.maximum(self.uncertainty, np.finfo(float).tiny))

    def findings(self, groups: Iterable[DepartureGroup]) -> tuple[Finding, ...]:
        """All of them."""
        return tuple(self._finding(one, group) for group in groups for one in group.departures)

    def _finding(self, one: SignificantDeparture, group: DepartureGroup) -> Finding:
        """A finding by itself; one that is alone in its group moves what the group does."""
        alone = len(group.departures) == 1
        shift, doubt = (group.shift, group.doubt) if alone else (one.score.shift, one.score.doubt)
        without = self._values_without(shift)
        impact = {
            n: 0.0 if self.admitted else float(v - without[n])
            for n, v in self.fitted.values.items()
        }
        message = f"{_said(one)} {self._without(one, shift, doubt, 'it')}"
        return Finding(one.code, one.record, one.candidate.time_s, one.chance, impact, message)

    def warning(self, group: DepartureGroup) -> ResultWarning:
        """One for all records of a group."""
        first = group.departures[0]
        others = len({one.record for one in group.departures}) - 1
        kinds = {
            one.departure: one for one in reversed(group.departures)
        }  # the most significant of each
        text = " ".join(_said(one) for one in sorted(kinds.values(), key=group.departures.index))
        if others:
            text = f"{text} So it is in {others} more record{'s' if others > 1 else ''}."
        if first.code == "nonlinear" and not self.fitted.evidence.model.is_linear:
            return ResultWarning(first.code, f"{text} {BESIDE_ITS_MIDDLE}")
        them = "it" if len(group.departures) == 1 else "them"
        return ResultWarning(
            first.code, f"{text} {self._without(first, group.shift, group.doubt, them)}"
        )

    def _values_without(self, shift: FloatArray) -> dict[str, float]:
        """Values of the parameters without a shift, as far as a linearised fit tells."""
        estimate = self.fitted.estimate
        return estimate.coordinates.values(estimate.z - np.clip(shift, -MAX_SHIFT, MAX_SHIFT))

    def _without(
        self, one: SignificantDeparture, shift: FloatArray, doubt: FloatArray, it: str
    ) -> str:
        """What the parameter that moves most would be."""
        evidence = self.fitted.evidence
        size = self.sizes(shift)
        name = evidence.model.parameter_names[int(np.argmax(size))]
        moved = f"{plain(float(np.max(size)), 2)} u"
        if np.max(size) < TOLD_FROM:
            return f"No parameter moves by {TOLD_FROM:g} u."
        at = int(np.argmax(size))
        if abs(shift[at]) < doubt[at] or abs(shift[at]) > MAX_SHIFT:
            return f"By how much {it} moves the {in_words(name)} the data do not tell.".replace(
                "them moves", "they move"
            )
        if one.departure.own_columns:  # the data do not tell which of them is wrong
            return f"Where it is largest, it moves the {in_words(name)} by {moved}."
        stated = self.fitted.values[name]
        without = self._values_without(shift)[name]
        here, there = (stated, without) if self.admitted else (without, stated)
        digits = _digits(here, there)
        unit = parameter_units(evidence.model, evidence.calibration)[name]
        values = f"{amount(here, unit, digits)} in place of {amount(there, unit, digits)}"
        would = f"the {in_words(name)} would be {values} ({moved})."
        if self.admitted:
            return f"The fit has {it} as nuisance parameters; without these {would}"
        return f"Without {it} {would}"


def _digits(one: float, other: float) -> int:
    """By which two values can be told apart, to a tenth of what they differ by."""
    apart = abs(one - other) / max(abs(one), np.finfo(float).tiny)
    return min(max(6, 2 - math.floor(math.log10(apart))), 15) if apart > 0.0 else 6


def _said(one: SignificantDeparture) -> str:
    text = one.sentence[:1].upper() + one.sentence[1:]
    text = text if text.endswith("?") else f"{text}."
    return text if one.record is None else f"{one.record}: {text}"

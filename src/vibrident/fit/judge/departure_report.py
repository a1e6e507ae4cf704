"""Departures from a fit, in words: findings of a result, and warnings of those that matter."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.data.records import FloatArray, Record
from vibrident.fit.departures.examination import DepartureGroup, SignificantDeparture, examine
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.departures.sources import groups_of, scale_of
from vibrident.fit.judge.attempts import DepartureReport, Fitted
from vibrident.fit.judge.hum import with_hum
from vibrident.fit.uncertainty.budget import patterns
from vibrident.fit.uncertainty.parameters import deviations, parameter_units
from vibrident.physics.naming import in_words
from vibrident.result import Finding, ResultWarning

#: Of a model with a bent spring.
OFF_CENTRE = (
    "The model has a spring that is bent alike on both sides of its rest; one that rests beside "
    "its middle, as under a static load, is not, and the parameters are off by more than their "
    "uncertainty says."
)
#: A linearised fit predicts no longer shift of a coordinate: a gain twice as large, e times the
#: frequency.
MAX_SHIFT = 1.0
#: A smaller shift, in standard uncertainties, is rounding or next to nothing: no number is stated.
MIN_STATED_SHIFT = 0.01


def departures_of(fitted: Fitted) -> tuple[DepartureGroup, ...]:
    """Return all departures from a fit, those of one kind together.

    They are tested unless the fit holds the outcome already.
    """
    estimate = fitted.estimate
    judgement = fitted.judgement
    if fitted.departures is not None:
        return fitted.departures
    if estimate.findings.decays is not None:  # free decays have tests of their own
        return ()
    return tuple(
        examine(
            groups_of(fitted.evidence, estimate, judgement.predicted, judgement.tone_points),
            scale_of(fitted.evidence, judgement.predicted, fitted.linear),
            _points(fitted),
            deviations(estimate.covariance),
            misfit=not fitted.adequate,
        )
    )


def departure_names(fitted: Fitted) -> set[str]:
    """Return the names of the kinds of departures from a fit."""
    return {
        departure.kind.name for group in departures_of(fitted) for departure in group.departures
    }


def with_nuisances(fitted: Fitted) -> tuple[Record, ...]:
    """Return the records with hum and departures as nuisance parameters where a fit can have them.

    A record that has them all already is returned itself.
    """
    records = fitted.evidence.records
    finds_hum = fitted.estimate.findings.noise is not None
    if records and fitted.evidence.model.is_linear and not finds_hum:
        transfer = functools.partial(
            fitted.evidence.model.frequency_response,
            fitted.values,
            quantity=fitted.evidence.quantity,
        )
        records = with_hum(records, fitted.judgement.predicted, transfer)
    # What some records show belongs to the channel, so all of them have it.
    for group in _nuisances(fitted):
        with_nuisance = group.departures[0].kind.with_nuisances
        records = tuple(
            record if record.reference is None else with_nuisance(record) for record in records
        )
    return records


def report_departures(fitted: Fitted, total: FloatArray) -> DepartureReport:
    """Return findings of all departures, and warnings of those that matter.

    ``total``: covariance of the coordinates as stated, systematic effects included, shape (p, p).
    """
    report = _Report(fitted, departures_of(fitted), deviations(total))
    # What another model explains is no defect of the data.
    explained = fitted.judgement.remedy_chi2 is not None
    return report.stated(report.groups, [] if explained else report.groups_that_matter())


def report_nuisances(fitted: Fitted) -> DepartureReport:
    """Return the report of departures that :func:`with_nuisances` gives the records.

    The values stated are then without them.
    """
    report = _Report.by_data_alone(fitted)
    groups = _nuisances(fitted)
    matter = [group for group in groups if group in report.groups_that_matter()]
    return replace(report, admitted=True).stated(groups, matter)


def _nuisances(fitted: Fitted) -> list[DepartureGroup]:
    """Return the departures that the fit can have as nuisance parameters.

    Beside a tone, where they cost most, these are only the ones that matter.
    """
    report = _Report.by_data_alone(fitted)
    in_time = fitted.estimate.criterion == "samples"
    groups = report.groups if in_time else report.groups_that_matter()
    return [group for group in groups if group.departures[0].kind.nuisance]


def _points(fitted: Fitted) -> PointsPart | None:
    """Return the response of a table or of sines at its points.

    It is None for other motion, and where no degree of freedom remains.
    """
    evidence = fitted.evidence
    judgement = fitted.judgement
    linear = fitted.linear
    has_points = evidence.calibration.table is not None or (
        evidence.only_sines and fitted.estimate.criterion != "samples"
    )
    if not has_points or not evidence.model.is_linear or judgement.adequacy.degrees_of_freedom <= 0:
        return None
    scatter = judgement.scatter or 1.0
    record = judgement.adequacy.record
    linear = replace(
        linear,
        matrix=linear.matrix / scatter,
        residual=linear.residual / scatter,
        weight=linear.weight / scatter,
    )
    common = linear.rows_of(patterns(fitted.effects, linear, linear.frequency_hz))
    transfer = evidence.model.frequency_response(
        fitted.values, linear.frequency_hz[: len(record)], "acceleration"
    )
    freedom = [points.freedom for points in judgement.points]
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
class _Report:
    """Findings and warnings of a fit's departures, in words.

    Attributes:
        fitted: the fit.
        groups: its departures.
        uncertainty: of the coordinates as stated, shape (p,).
        admitted: whether the fit that states the result has the departures as nuisance parameters,
            and is not this one.
    """

    fitted: Fitted
    groups: tuple[DepartureGroup, ...]
    uncertainty: FloatArray
    admitted: bool = False

    @classmethod
    def by_data_alone(cls, fitted: Fitted) -> _Report:
        """Build the report of a fit with uncertainties without systematic effects."""
        return cls(fitted, departures_of(fitted), deviations(fitted.estimate.covariance))

    def groups_that_matter(self) -> list[DepartureGroup]:
        """Return the departures that matter.

        They move a parameter by its standard uncertainty, are the most significant of a misfit, or
        have effects that no first order shows: an interferometer that is wrong at a harmonic is
        wrong at the tone, and a spring that rests beside its middle moves the parameters by the
        square of its distance.
        """
        adequacy = self.fitted.judgement.adequacy
        unexplained = not adequacy.adequate and adequacy.degrees_of_freedom > 0
        return [
            group
            for number, group in enumerate(self.groups)
            if np.max(self._sizes(group.shift), initial=0.0) >= 1.0
            or (unexplained and number == 0)
            or group.departures[0].code == "few_fringes"
            or self._is_bent_spring(group)
        ]

    def _is_bent_spring(self, group: DepartureGroup) -> bool:
        """Return whether departures are nonlinear beside a model that is nonlinear itself."""
        is_linear = self.fitted.evidence.model.is_linear
        return group.departures[0].code == "nonlinear" and not is_linear

    def _sizes(self, shift: FloatArray) -> FloatArray:
        """Return a shift of the coordinates, in their standard uncertainties."""
        return np.abs(shift) / np.maximum(self.uncertainty, np.finfo(float).tiny)

    def stated(
        self, groups: Iterable[DepartureGroup], warned: Iterable[DepartureGroup]
    ) -> DepartureReport:
        """Return the findings of ``groups``, and the warnings of the groups ``warned``."""
        return DepartureReport(
            tuple(
                self._finding(departure, group)
                for group in groups
                for departure in group.departures
            ),
            tuple(self._warning(group) for group in warned),
        )

    def _finding(self, departure: SignificantDeparture, group: DepartureGroup) -> Finding:
        """Return a departure's finding.

        A departure that is alone in its group moves what the group does.
        """
        moving = group if len(group.departures) == 1 else departure.score
        without = self._values_without(moving.shift)
        impact = {
            name: 0.0 if self.admitted else float(value - without[name])
            for name, value in self.fitted.values.items()
        }
        return Finding(
            departure.code,
            departure.record,
            departure.candidate.time_s,
            departure.chance,
            impact,
            f"{_describe(departure)} {self._without(departure, moving, 'it')}",
        )

    def _warning(self, group: DepartureGroup) -> ResultWarning:
        """Return the warning of a group, one for all its records."""
        first = group.departures[0]
        # The most significant of each kind.
        kinds = {departure.kind: departure for departure in reversed(group.departures)}
        text = " ".join(
            _describe(departure) for departure in sorted(kinds.values(), key=group.departures.index)
        )
        described = {departure.record for departure in kinds.values()}
        records = {departure.record for departure in group.departures}
        # No record is named by what all records show together.
        more_records = len(records - described - {None, ""})
        if more_records:
            text = (
                f"{text} So it is in {more_records} more record{'s' if more_records > 1 else ''}."
            )
        pronoun = "it" if len(group.departures) == 1 else "them"
        consequence = (
            OFF_CENTRE if self._is_bent_spring(group) else self._without(first, group, pronoun)
        )
        return ResultWarning(first.code, f"{text} {consequence}")

    def _values_without(self, shift: FloatArray) -> dict[str, float]:
        """Return the parameters without a shift, as far as a linearised fit tells."""
        estimate = self.fitted.estimate
        return estimate.coordinates.values(estimate.z - np.clip(shift, -MAX_SHIFT, MAX_SHIFT))

    def _without(
        self, departure: SignificantDeparture, moving: DepartureGroup | Score, pronoun: str
    ) -> str:
        """Return the sentence on the value, without the departures, of the parameter moved most.

        Args:
            departure: of which the sentence is.
            moving: what shifts the parameters.
            pronoun: of the departures, ``it`` or ``them``.
        """
        evidence = self.fitted.evidence
        sizes = self._sizes(moving.shift)
        index = int(np.argmax(sizes))
        shift = moving.shift[index]
        name = evidence.model.parameter_names[index]
        if departure.kind.own_columns and not np.any(moving.shift):
            return "No single band shows by how much the parameters are off."
        if sizes[index] < MIN_STATED_SHIFT:
            return f"No parameter moves by {MIN_STATED_SHIFT:g} u."
        if abs(shift) < moving.doubt[index] or abs(shift) > MAX_SHIFT:
            moves = "it moves" if pronoun == "it" else "they move"
            return f"By how much {moves} the {in_words(name)} the data do not tell."
        shift_in_u = f"{plain(float(sizes[index]), 2)} u"
        if departure.kind.own_columns:  # the data do not determine which of them is wrong
            return f"Where it is largest, it moves the {in_words(name)} by {shift_in_u}."
        stated = self.fitted.values[name]
        without = self._values_without(moving.shift)[name]
        alternative, fitted = (stated, without) if self.admitted else (without, stated)
        digits = _digits(alternative, fitted)
        unit = parameter_units(evidence.model, evidence.calibration)[name]
        values = f"{amount(alternative, unit, digits)} in place of {amount(fitted, unit, digits)}"
        change = f"the {in_words(name)} would be {values} ({shift_in_u})."
        if self.admitted:
            return f"The fit has {pronoun} as nuisance parameters; without these {change}"
        return f"Without {pronoun} {change}"


def _digits(first: float, second: float) -> int:
    """Return the digits by which two values differ, to a tenth of their difference."""
    difference = abs(first - second) / max(abs(first), np.finfo(float).tiny)
    return min(max(6, 2 - math.floor(math.log10(difference))), 15) if difference > 0.0 else 6


def _describe(departure: SignificantDeparture) -> str:
    """Return the sentence on a departure, with its record where it is of one."""
    text = departure.sentence[:1].upper() + departure.sentence[1:]
    text = text if text.endswith("?") else f"{text}."
    return text if departure.record is None else f"{departure.record}: {text}"

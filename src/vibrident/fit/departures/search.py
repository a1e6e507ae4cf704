"""Significant departures in a pass over the groups of a fit.

The bound comes first, then the tests of what it leaves. One rate for all: in a clean calibration
noise shows a departure with the chance FALSE_ALARMS, once for the records and once for points,
shared among the kinds, the records and the places of each.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Departure, Places, Scale, pooled
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.score import LinearFit, Score
from vibrident.fit.departures.sums import ExactSums, RecordInformation
from vibrident.fit.registry import DEPARTURES

#: Chance that noise alone shows any departure in a calibration.
FALSE_ALARMS = 1e-4
#: What the bound leaves has at most so many times that chance: it counts dependent columns
#: otherwise than the test.
BOUND_MARGIN = 10.0
#: All records together are not tested where noise explains as much with this chance: of many
#: columns the quietest level of the noise bounds nothing.
MAX_JOINT_CHANCE = 0.05
#: Places, of those that explain most by the bound, that are tested.
MAX_TESTED = 3


@dataclass(frozen=True, eq=False)
class SignificantDeparture:
    """A significant departure.

    Attributes:
        kind: of departure.
        candidate: the place, and its words.
        score: the test there.
        chance: that noise shows it anywhere.
        place: number of the record; None where it concerns all.
        record: name of the record; None likewise.
    """

    kind: Departure
    candidate: Candidate
    score: Score
    chance: float
    place: int | None
    record: str | None

    @property
    def code(self) -> WarningCode:
        """Return the code of the warning where it matters."""
        return self.kind.code_of(self.candidate, self.score)

    @property
    def sentence(self) -> str:
        """Return the clause on what is there."""
        return self.kind.sentence(self.candidate, self.score)


@dataclass(eq=False)
class PendingTest:
    """The places of a departure that the bound leaves, in a record or in all, and their tests.

    The tests are filled in once they are made.

    Attributes:
        kind: of departure.
        place: number of the record; None of all.
        record: name of the record; None of all.
        several: tests that share the rate.
        candidates: places, that which explains most first.
        joint: whether all records are tested, each with amounts of its own.
        tested: the candidates with their sums.
        chosen: which of these is the first that is significant.
    """

    kind: Departure
    place: int | None
    record: str | None
    several: int
    candidates: Sequence[Candidate] = ()
    joint: bool = False
    tested: list[tuple[Candidate, ExactSums]] = field(default_factory=list)
    chosen: int = 0


@dataclass(frozen=True, eq=False)
class _GroupBounds:
    """The sums of a group that the first pass keeps.

    Attributes:
        information: on the coordinates, of its records.
        numbers: of the records.
        names: of the records.
        places: of each departure whose amounts records do not share.
    """

    information: RecordInformation
    numbers: list[int]
    names: list[str]
    places: Mapping[Departure, list[Places]]


def of_records(
    groups: Iterable[WhitenedGroup], scale: Scale, uncertainty: FloatArray
) -> list[SignificantDeparture]:
    """Return the significant departures of records.

    The bound takes a pass over the groups, and tests take another where that leaves something.
    """
    kinds = DEPARTURES.all()
    departures = [
        departure for departure in kinds.values() if departure.of_light or not scale.narrow
    ]
    pooled_places = dict[Departure, list[Places]]()
    bounds = list[_GroupBounds]()
    for group in groups:
        places_by_departure = dict[Departure, list[Places]]()
        for departure in departures:
            places = departure.places(group, scale)
            if departure.pooled:
                totals = [replace(of_width, sums=of_width.sums.total()) for of_width in places]
                pooled_places[departure] = (
                    pooled(pooled_places[departure], totals) if bounds else totals
                )
            else:
                places_by_departure[departure] = places
        names = [record.name for record in group.records]
        bounds.append(
            _GroupBounds(group.information, group.numbers.tolist(), names, places_by_departure)
        )
        del group  # before the next one is made
    if not bounds:
        return []
    information = RecordInformation.joined([bound.information for bound in bounds])
    fit = LinearFit.from_records(information, uncertainty)
    count = len(information.chi2)
    quietest = np.min(information.quietest)
    tests = [
        _bound_pooled(fit, departure, pooled_places[departure], quietest, len(kinds))
        for departure in pooled_places
    ]
    for departure in departures:
        if departure.pooled:
            continue
        several = len(kinds) * count * (2 if departure.together else 1)
        joint_tests = (
            _bound_all_records(fit, departure, bounds, several) if departure.together else []
        )
        tests += joint_tests or [
            test for bound in bounds for test in _bound_each_record(fit, departure, bound, several)
        ]
    tests = [test for test in tests if test.candidates]
    return _run_tests(groups, scale, fit, tests) if tests else []


def _bound_pooled(
    fit: LinearFit, departure: Departure, places: Sequence[Places], quietest: float, several: int
) -> PendingTest:
    """Return the test of a departure whose amounts records share, with the places bounded."""
    several *= sum(len(places_of_width.candidates) for places_of_width in places)
    candidates = list[tuple[float, Candidate]]()
    for places_of_width in places:
        explained, columns = fit.explained(places_of_width.sums)
        possible = fit.may_be_significant(
            explained, columns, np.array(quietest), BOUND_MARGIN * FALSE_ALARMS / several
        )
        candidates += [
            (explained[k] - columns[k], places_of_width.candidates[k])
            for k in np.flatnonzero(possible).tolist()
        ]
    return PendingTest(departure, None, None, several, _strongest_first(candidates))


def _strongest_first(candidates: list[tuple[float, Candidate]]) -> list[Candidate]:
    """Return the candidates that explain most, the strongest first."""
    return [
        candidate for _, candidate in sorted(candidates, key=lambda entry: -entry[0])[:MAX_TESTED]
    ]


def _bound_each_record(
    fit: LinearFit, departure: Departure, bounds: _GroupBounds, several: int
) -> list[PendingTest]:
    """Return the tests of a departure in each record of a group where the bound leaves places."""
    places = bounds.places[departure]
    information = bounds.information
    if not places:
        return []
    counts = np.sum([np.sum(places_of_width.present, axis=1) for places_of_width in places], axis=0)
    candidates = [list[tuple[float, Candidate]]() for _ in bounds.numbers]
    for places_of_width in places:
        sums = (
            places_of_width.sums.within(information.with_axis(1), fit.inverse)
            if departure.within
            else places_of_width.sums
        )
        explained, columns = fit.explained(sums)
        chance = BOUND_MARGIN * FALSE_ALARMS / (several * max(int(np.max(counts)), 1))
        possible = (
            fit.may_be_significant(explained, columns, information.quietest[:, None], chance)
            & places_of_width.present
        )
        for record, place in np.argwhere(possible).tolist():
            candidates[record].append(
                (
                    explained[record, place] - columns[record, place],
                    places_of_width.candidates[place],
                )
            )
    entries = zip(bounds.numbers, bounds.names, counts.tolist(), candidates, strict=True)
    return [
        PendingTest(departure, number, name, several * count, _strongest_first(of_record))
        for number, name, count, of_record in entries
        if of_record
    ]


def _bound_all_records(
    fit: LinearFit, departure: Departure, bounds: Sequence[_GroupBounds], several: int
) -> list[PendingTest]:
    """Return tests of all records where their first places may be significant together.

    T adds up beside each record's own parameters.
    """
    total = 0.0
    columns = 0
    tests = list[PendingTest]()
    for bound in bounds:
        for first in bound.places[departure][:1]:
            explained, number = fit.explained(
                first.sums.at((slice(None), 0)).within(bound.information, fit.inverse)
            )
            total += float(np.sum(explained))
            columns += int(np.sum(number))
            for record in zip(bound.numbers, bound.names, strict=True):
                tests.append(
                    PendingTest(departure, *record, several, first.candidates[:1], joint=True)
                )
    possible = fit.may_be_significant(
        np.array([total]), np.array([columns]), np.ones(1), MAX_JOINT_CHANCE
    )
    return tests if possible[0] else []


def _run_tests(
    groups: Iterable[WhitenedGroup], scale: Scale, fit: LinearFit, tests: Sequence[PendingTest]
) -> list[SignificantDeparture]:
    """Return what is significant of what the bound leaves, by tests in one pass over the groups."""
    spreads = list[FloatArray]()
    commons = list[FloatArray]()
    for group in groups:
        for sums, array in zip((spreads, commons), group.spread, strict=True):
            sums.append(np.sum(array, axis=0))
        for test in tests:
            _add_group(test, group, scale, fit)
        del group
    fit = replace(fit, spread=np.sum(spreads, axis=0), common=np.sum(commons, axis=0))
    kinds = dict.fromkeys(test.kind for test in tests)
    significant_by_kind = [
        _significant_of_kind(fit, [test for test in tests if test.kind is departure])
        for departure in kinds
    ]
    return [departure for significant in significant_by_kind for departure in significant]


def _significant_of_kind(
    fit: LinearFit, tests: Sequence[PendingTest]
) -> list[SignificantDeparture]:
    """Return what is significant of a departure: in all records together, or in each."""
    if tests[0].joint and (together := _significant_together(fit, tests)):
        return together
    bests = [best_of(fit, test) for test in tests]
    return [best for best in bests if best is not None]


def _significant_together(
    fit: LinearFit, pending: Sequence[PendingTest]
) -> list[SignificantDeparture]:
    """Return all records where these show a departure together, each with amounts of its own.

    There are none where they do not.
    """
    results = [(test, fit.test(test.tested[0][1])) for test in pending if test.tested]
    scores = [(test, score) for test, score in results if score is not None and score.chance < 1.0]
    if not scores:
        return []
    columns = sum(score.columns for _, score in scores)
    statistic, explained = (
        sum(getattr(score, name) for _, score in scores) for name in ("statistic", "explained")
    )
    noise_freedom = min(score.noise_freedom for _, score in scores)
    chance = (
        fit.chance(statistic, explained + columns, columns, noise_freedom)
        * 2
        * len(DEPARTURES.all())
    )
    if chance >= FALSE_ALARMS:
        return []
    return [
        SignificantDeparture(test.kind, test.tested[0][0], score, chance, test.place, test.record)
        for test, score in scores
    ]


def _add_group(test: PendingTest, group: WhitenedGroup, scale: Scale, fit: LinearFit) -> None:
    """Add the sums of a group to the candidates of a pending test."""
    places = group.numbers.tolist()
    if test.place is not None and test.place not in places:
        return
    members = group if test.place is None else group.subset([places.index(test.place)])
    for number, candidate in enumerate(test.candidates):
        refined, sums = _exact_sums(test.kind, candidate, members, scale)
        if test.kind.within:
            sums = sums.exactly_within(members.information, fit.inverse, *members.spread)
        if len(test.tested) <= number:
            test.tested.append((refined, sums.total()))
        else:
            test.tested[number] = (refined, test.tested[number][1] + sums.total())


def _exact_sums(
    departure: Departure, candidate: Candidate, group: WhitenedGroup, scale: Scale
) -> tuple[Candidate, ExactSums]:
    """Return a place with the sums of its columns in each record, and their covariance."""
    sums = group.exact_sums(
        departure.whitened(candidate, group, scale), departure.doubt(candidate, group, scale)
    )
    return departure.refined(candidate, group, scale, sums)


def best_of(fit: LinearFit, pending: PendingTest) -> SignificantDeparture | None:
    """Return the first candidate that is significant, or None."""
    for number, (candidate, sums) in enumerate(pending.tested):
        score = fit.test(sums)
        if score is None or score.chance * pending.several >= FALSE_ALARMS:
            continue
        pending.chosen = number
        if pending.kind.own_columns:
            # The shift is that of the significant pair that moves the parameters most.
            pairs = [
                fit.test(sums.of_columns([column, column + 1]))
                for column in range(0, len(sums.score), 2)
            ]
            tested = [score_of_pair for score_of_pair in pairs if score_of_pair is not None]
            shifts = [
                score_of_pair.shift
                for score_of_pair in tested
                if score_of_pair.chance * pending.several * len(pairs) < FALSE_ALARMS
            ]
            score = replace(
                score, shift=max(shifts, key=fit.impact, default=np.zeros_like(score.shift))
            )
        chance = score.chance * pending.several
        return SignificantDeparture(
            pending.kind, candidate, score, chance, pending.place, pending.record
        )
    return None

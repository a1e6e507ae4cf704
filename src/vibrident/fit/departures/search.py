"""Significant departures in a pass over the groups of a fit: first the bound, then the tests of what it leaves.

One rate for all: in a clean calibration noise shows a departure with the chance FALSE_ALARMS, once for the records and
once for points, shared among the kinds, the records and the places of each.
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
from vibrident.fit.departures.sums import Exact, Own
from vibrident.fit.registry import DEPARTURES

#: Chance that noise alone shows any departure in a calibration.
FALSE_ALARMS = 1e-4
#: What the bound leaves has at most so many times that chance: it counts dependent columns otherwise than the test.
MARGIN = 10.0
#: All records together are not asked where noise explains as much with this chance: of many columns the quietest level
#: of the noise bounds nothing.
MAX_NOT_ASKED = 0.05
#: Places, of those that explain most by the bound, that are tested.
MAX_TESTED = 3


@dataclass(frozen=True, eq=False)
class Found:
    """A significant departure.

    Attributes:
        departure: the kind.
        candidate: the place, and its words.
        score: the test there.
        chance: that noise shows it anywhere.
        place: number of the record; None where it concerns all.
        record: name of the record; None likewise.
    """

    departure: Departure
    candidate: Candidate
    score: Score
    chance: float
    place: int | None
    record: str | None

    @property
    def code(self) -> WarningCode:
        """Of the warning where it matters."""
        return self.departure.code_of(self.candidate, self.score)

    @property
    def sentence(self) -> str:
        """What is there."""
        return self.departure.sentence(self.candidate, self.score)


@dataclass(eq=False)
class Asked:
    """What the bound leaves of a departure, in a record or in all, and its tests once they are made.

    Attributes:
        departure: the kind.
        place: number of the record; None of all.
        record: name of the record; None of all.
        several: tests that share the rate.
        candidates: places, that which explains most first.
        joint: whether all records are asked, each with amounts of its own.
        tested: the candidates with their sums.
        chosen: which of these is the first that is significant.
    """

    departure: Departure
    place: int | None
    record: str | None
    several: int
    candidates: Sequence[Candidate] = ()
    joint: bool = False
    tested: list[tuple[Candidate, Exact]] = field(default_factory=list)
    chosen: int = 0


@dataclass(frozen=True, eq=False)
class _Seen:
    """What the first pass keeps of a group: what its records say, their numbers and names, and the places of each."""

    own: Own
    numbers: list[int]
    names: list[str]
    places: Mapping[Departure, list[Places]]


def of_records(
    groups: Iterable[WhitenedGroup], scale: Scale, uncertainty: FloatArray
) -> list[Found]:
    """Significant departures: the bound in a pass over the groups, and tests in another where that leaves something."""
    kinds = DEPARTURES.all()
    looked = [departure for departure in kinds.values() if departure.of_light or not scale.narrow]
    shared = dict[Departure, list[Places]]()
    seen = list[_Seen]()
    for group in groups:
        own = dict[Departure, list[Places]]()
        for departure in looked:
            places = departure.places(group, scale)
            if departure.pooled:
                total = [replace(one, sums=one.sums.total()) for one in places]
                shared[departure] = pooled(shared[departure], total) if seen else total
            else:
                own[departure] = places
        names = [record.name for record in group.records]
        seen.append(_Seen(group.own, group.numbers.tolist(), names, own))
        del group  # before the next one is made
    if not seen:
        return []
    all_own = Own.joined([one.own for one in seen])
    fit = LinearFit.of(all_own, uncertainty)
    count = len(all_own.chi2)
    quietest = np.min(all_own.quietest)
    asked = [
        _of_all(fit, departure, shared[departure], quietest, len(kinds)) for departure in shared
    ]
    for departure in looked:
        if departure.pooled:
            continue
        several = len(kinds) * count * (2 if departure.together else 1)
        every = _of_every(fit, departure, seen, several) if departure.together else []
        asked += every or [each for one in seen for each in _of_each(fit, departure, one, several)]
    asked = [one for one in asked if one.candidates]
    return _tested(groups, scale, fit, asked) if asked else []


def _of_all(
    fit: LinearFit, departure: Departure, places: Sequence[Places], quietest: float, several: int
) -> Asked:
    """What the bound leaves of a departure whose amounts records share."""
    several *= sum(len(some.candidates) for some in places)
    left = list[tuple[float, Candidate]]()
    for some in places:
        explained, columns = fit.explained(some.sums)
        maybe = fit.may_be(explained, columns, np.array(quietest), MARGIN * FALSE_ALARMS / several)
        left += [
            (explained[k] - columns[k], some.candidates[k]) for k in np.flatnonzero(maybe).tolist()
        ]
    return Asked(departure, None, None, several, _first(left))


def _first(left: list[tuple[float, Candidate]]) -> list[Candidate]:
    return [candidate for _, candidate in sorted(left, key=lambda one: -one[0])[:MAX_TESTED]]


def _of_each(fit: LinearFit, departure: Departure, seen: _Seen, several: int) -> list[Asked]:
    """What the bound leaves of a departure in each record of a group."""
    places = seen.places[departure]
    own = seen.own
    if not places:
        return []
    counts = np.sum([np.sum(some.there, axis=1) for some in places], axis=0)
    left = [list[tuple[float, Candidate]]() for _ in seen.numbers]
    for some in places:
        sums = some.sums.within(own.along(1), fit.inverse) if departure.within else some.sums
        explained, columns = fit.explained(sums)
        chance = MARGIN * FALSE_ALARMS / (several * max(int(np.max(counts)), 1))
        maybe = fit.may_be(explained, columns, own.quietest[:, None], chance) & some.there
        for record, place in np.argwhere(maybe).tolist():
            left[record].append(
                (explained[record, place] - columns[record, place], some.candidates[place])
            )
    every = zip(seen.numbers, seen.names, counts.tolist(), left, strict=True)
    return [
        Asked(departure, number, name, several * many, _first(some))
        for number, name, many, some in every
        if some
    ]


def _of_every(
    fit: LinearFit, departure: Departure, seen: Sequence[_Seen], several: int
) -> list[Asked]:
    """Ask all records, where their first places could be significant together: T add up beside own parameters."""
    total = 0.0
    columns = 0
    asked = list[Asked]()
    for one in seen:
        for first in one.places[departure][:1]:
            explained, number = fit.explained(
                first.sums.at((slice(None), 0)).within(one.own, fit.inverse)
            )
            total += float(np.sum(explained))
            columns += int(np.sum(number))
            for record in zip(one.numbers, one.names, strict=True):
                asked.append(Asked(departure, *record, several, first.candidates[:1], joint=True))
    maybe = fit.may_be(np.array([total]), np.array([columns]), np.ones(1), MAX_NOT_ASKED)
    return asked if maybe[0] else []


def _tested(
    groups: Iterable[WhitenedGroup], scale: Scale, fit: LinearFit, asked: Sequence[Asked]
) -> list[Found]:
    """The tests of what the bound leaves, in one pass over the groups."""
    spreads = list[FloatArray]()
    commons = list[FloatArray]()
    for group in groups:
        for made, part in zip((spreads, commons), group.spread, strict=True):
            made.append(np.sum(part, axis=0))
        for one in asked:
            _ask(one, group, scale, fit)
        del group
    fit = replace(fit, spread=np.sum(spreads, axis=0), common=np.sum(commons, axis=0))
    kinds = dict.fromkeys(one.departure for one in asked)
    every = [
        _found(fit, [one for one in asked if one.departure is departure]) for departure in kinds
    ]
    return [one for found in every for one in found]


def _found(fit: LinearFit, asked: Sequence[Asked]) -> list[Found]:
    """What is significant of a departure: in all records together, or in each."""
    if asked[0].joint and (together := _together(fit, asked)):
        return together
    bests = [best_of(fit, one) for one in asked]
    return [best for best in bests if best is not None]


def _together(fit: LinearFit, asked: Sequence[Asked]) -> list[Found]:
    """All records, where these show a departure together, each with amounts of its own; else none."""
    tests = [(one, fit.test(one.tested[0][1])) for one in asked if one.tested]
    scores = [(one, score) for one, score in tests if score is not None and score.chance < 1.0]
    if not scores:
        return []
    columns = sum(score.columns for _, score in scores)
    statistic, explained = (
        sum(getattr(score, name) for _, score in scores) for name in ("statistic", "explained")
    )
    told = min(score.told for _, score in scores)
    chance = fit.chance(statistic, explained + columns, columns, told) * 2 * len(DEPARTURES.all())
    if chance >= FALSE_ALARMS:
        return []
    return [
        Found(one.departure, one.tested[0][0], score, chance, one.place, one.record)
        for one, score in scores
    ]


def _ask(one: Asked, group: WhitenedGroup, scale: Scale, fit: LinearFit) -> None:
    """Add what a group says of the candidates of a departure."""
    places = group.numbers.tolist()
    if one.place is not None and one.place not in places:
        return
    part = group if one.place is None else group.only([places.index(one.place)])
    for number, candidate in enumerate(one.candidates):
        told, sums = _exact(one.departure, candidate, part, scale)
        if one.departure.within:
            sums = sums.exactly_within(part.own, fit.inverse, *part.spread)
        if len(one.tested) <= number:
            one.tested.append((told, sums.total()))
        else:
            one.tested[number] = (told, one.tested[number][1] + sums.total())


def _exact(
    departure: Departure, candidate: Candidate, group: WhitenedGroup, scale: Scale
) -> tuple[Candidate, Exact]:
    """A place with the sums of its columns in each record, and their covariance."""
    sums = group.exact_sums(
        departure.whitened(candidate, group, scale), departure.doubt(candidate, group, scale)
    )
    return departure.refined(candidate, group, scale, sums)


def best_of(fit: LinearFit, asked: Asked) -> Found | None:
    """The first candidate that is significant."""
    for number, (candidate, sums) in enumerate(asked.tested):
        score = fit.test(sums)
        if score is None or score.chance * asked.several >= FALSE_ALARMS:
            continue
        asked.chosen = number
        if asked.departure.own_columns:  # of that significant pair that moves the parameters most
            pairs = [
                fit.test(sums.some([first, first + 1])) for first in range(0, len(sums.score), 2)
            ]
            every = [pair for pair in pairs if pair is not None]
            alone = [
                pair.shift
                for pair in every
                if pair.chance * asked.several * len(pairs) < FALSE_ALARMS
            ]
            score = replace(
                score, shift=max(alone, key=fit.impact, default=np.zeros_like(score.shift))
            )
        chance = score.chance * asked.several
        return Found(asked.departure, candidate, score, chance, asked.place, asked.record)
    return None

"""What departs from a fit significantly, and how far it moves the parameters.

One rate for all: in a clean calibration noise shows a departure with the chance FALSE_ALARMS, once for the records and
once for points, shared among the kinds, the records and the places of each. The one that explains most becomes a
nuisance parameter, and the others are tested beside it, as a step in time imitates a misfit over frequency, and the
other way round.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, reduce

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.candidate import Candidate, Places
from vibrident.fit.departures.departure import Departure, Scale, in_widths
from vibrident.fit.departures.part import Own, Part, Parts
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.score import LinearFit, Score, Sums
from vibrident.fit.registry import DEPARTURES

#: Chance that noise alone shows any departure in a calibration.
FALSE_ALARMS = 1e-4
#: Places, of those that explain most by sums over blocks, whose columns are whitened one by one.
MOST_EXACT = 3
#: Departures that are looked for beside each other.
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Found:
    """A significant departure.

    Attributes:
        departure: the kind.
        candidate: the place, and its words.
        score: the test there.
        chance: that noise shows it anywhere.
        place: number of the part; None where it concerns all.
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


@dataclass(frozen=True, eq=False)
class Together:
    """Departures of one kind, by record or of all.

    Attributes:
        found: these, the most significant first.
        moved: makes how far they move the coordinates together.
    """

    found: tuple[Found, ...]
    moved: Callable[[], FloatArray]

    @cached_property
    def shift(self) -> FloatArray:
        """How far they move the coordinates together, shape (P,)."""
        return self.moved()


def examine(
    parts: Parts, scale: Scale, points: PointsPart | None, uncertainty: FloatArray, *, misfit: bool = False
) -> list[Together]:
    """Every significant departure, the most significant first.

    Args:
        parts: the records of the fit.
        scale: what they have in common.
        points: its response at points, where that is what was fitted.
        uncertainty: of the coordinates as stated, shape (P,).
        misfit: whether the model does not explain the data: then what explains most is asked for alone.
    """
    rounds = 1 if misfit else ROUNDS
    found = _among_records(parts, scale, uncertainty, rounds)
    return found + ([] if points is None else _among_points(points, uncertainty, rounds))


def _among_records(parts: Parts, scale: Scale, uncertainty: FloatArray, rounds: int) -> list[Together]:
    """Departures are told apart in the noise that was read without them, which holds what they make of it too."""
    found, beside = list[list[Found]](), parts
    for number in range(rounds):
        beside = beside.beside(partial(_whitened, found[-1], scale)) if number else parts
        now = _strongest(_of_records(beside, scale, uncertainty))
        if not now:
            break
        found.append(now)
    if rounds == 1:  # parameters of a model that is wrong: the noise beside a departure makes them no truer
        return [_together(now) for now in found]
    shifts = cache(lambda: _shifts(parts, found, scale, uncertainty))
    return _of_one_kind([_together(now, lambda k=k: shifts()[k]) for k, now in enumerate(found)])


def _whitened(found: Sequence[Found], scale: Scale, number: int, part: Part) -> list[FloatArray]:
    """Columns of the departures of a part, whitened."""
    return [one.departure.whitened(one.candidate, part, scale) for one in found if one.place in (None, number)]


def _shifts(parts: Parts, found: Sequence[Sequence[Found]], scale: Scale, uncertainty: FloatArray) -> list[FloatArray]:
    """How far the departures of each round move the coordinates, by the amounts that all have together.

    In the noise that is left beside them, and by amounts of each record's own: what only looks alike in all, as a level
    that each record exceeds by its own part, moves each by its own. Where they are alike this costs no precision. How
    far the optimum itself is another one in that noise counts to the first.
    """
    shifts = [np.zeros(len(uncertainty)) for _ in found]
    every = [(number, one) for number, now in enumerate(found) for one in now if not one.departure.own_columns]
    if not every:
        return shifts
    before, beside, own = list[Own](), list[Own](), list[Sums]()
    rounds, sizes = list[int](), list[float]()
    for place, part in enumerate(parts):
        here = [(number, one) for number, one in every if one.place in (None, place)]
        quiet = part.in_noise_beside([one.departure.columns_of(one.candidate, part, scale) for _, one in here])
        before.append(part.own)
        beside.append(quiet.own)
        if rows := _whitened([one for _, one in here], scale, place, quiet):
            rounds += np.repeat([number for number, _ in here], [len(each) for each in rows]).tolist()
            sizes += np.concatenate([np.abs(one.score.amounts) for _, one in here]).tolist()
            own.append(Sums.of(quiet, np.concatenate(rows), len(uncertainty)))
    fit = LinearFit.of(beside, uncertainty)
    for number, moved in zip(rounds, fit.moved(Sums.side_by_side(own), np.array(sizes)), strict=True):
        shifts[number] += moved
    shifts[every[0][0]] += LinearFit.of(before, uncertainty).optimum(before) - fit.optimum(beside)
    return shifts


def _of_one_kind(every: list[Together]) -> list[Together]:
    """Those of a kind told record by record are one, whatever the round, as some records show it better than others.

    So are those of a family.
    """
    kinds = dict[Departure | int | str, list[Together]]()
    for number, one in enumerate(every):
        departure = one.found[0].departure
        kinds.setdefault(departure.family or (number if departure.pooled else departure), []).append(one)
    return [_joined_groups(some) for some in kinds.values()]


def _joined_groups(some: Sequence[Together]) -> Together:
    found = tuple(one for group in some for one in group.found)
    return Together(found, lambda: np.sum([group.shift for group in some], axis=0))


def _among_points(points: PointsPart, uncertainty: FloatArray, rounds: int) -> list[Together]:
    found, fit = list[Together](), points.fit(uncertainty)
    for _ in range(rounds):
        now = _strongest(_of_points(fit, points))
        if not now:
            break
        before = fit.optimum([])
        points = reduce(
            PointsPart.beside, (one.candidate.rows for one in now if one.candidate.rows is not None), points
        )
        fit = points.fit(uncertainty)
        found.append(_together(now, partial(np.subtract, before, fit.optimum([]))))
    return found


def _together(found: Sequence[Found], moved: Callable[[], FloatArray] | None = None) -> Together:
    """``moved``: makes the shift of the fit beside all of them; None: as each of them shows it."""
    if moved is None or not found[0].departure.joint:
        moved = partial(np.sum, [one.score.shift for one in found], axis=0)
    return Together(tuple(found), moved)


def _strongest(found: Sequence[Found]) -> list[Found]:
    """The departure that explains most; where that is of records, in all in which it is."""
    if not found:
        return []
    kinds = {one.departure for one in found}
    explained = {kind: sum(one.score.explained for one in found if one.departure is kind) for kind in kinds}
    best = max(explained, key=lambda kind: explained[kind])
    return sorted((one for one in found if one.departure is best), key=lambda one: -one.score.explained)


def _of_points(fit: LinearFit, points: PointsPart) -> list[Found]:
    kinds, found = DEPARTURES.all(), list[Found]()
    for departure in kinds.values():
        best = _best(fit, departure, _sure(fit, departure, in_widths(departure.at_points(points)), len(kinds)))
        if best is not None:
            found.append(Found(departure, *best, None, best[0].record))
    return found


def _of_records(parts: Parts, scale: Scale, uncertainty: FloatArray) -> list[Found]:
    """One pass over the parts, and one more where a place is significant by approximate sums."""
    kinds = DEPARTURES.all()
    looked = [departure for departure in kinds.values() if departure.of_light or not scale.narrow]
    every, seen = dict[Departure, list[Places]](), list[_Seen]()
    for part in parts:
        own = {departure: departure.places(part, scale, len(uncertainty)) for departure in looked}
        for departure in [departure for departure in looked if departure.pooled]:
            places = own.pop(departure)
            every[departure] = _pooled(every[departure], places) if seen else places
        seen.append(_Seen(len(seen), part.record.name, part.own, own))
        del part  # before the next one is made
    if not seen:
        return []
    fit, found = LinearFit.of([one.own for one in seen], uncertainty), list[Found]()
    for departure in looked:
        if departure.pooled:
            best = _best(fit, departure, _sure(fit, departure, every[departure], len(kinds)))
            found += [] if best is None else [Found(departure, *best, None, None)]
            continue
        several = len(kinds) * len(seen) * (2 if departure.together else 1)
        sure = [_sure(fit, departure, one.places[departure], several, one.own) for one in seen]
        if departure.approximate and any(sure):
            sure = [_exactly(fit, departure, tests, part, scale) for tests, part in zip(sure, parts, strict=True)]
        bests = [(one, _best(fit, departure, tests)) for one, tests in zip(seen, sure, strict=True)]
        alone = [Found(departure, *best, one.place, one.record) for one, best in bests if best is not None]
        found += (departure.together and _of_all(fit, departure, seen, 2 * len(kinds))) or alone
    return found


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a pass keeps of a part: its number, the record's name, what it says, and the places of each departure."""

    place: int
    record: str
    own: Own
    places: Mapping[Departure, Sequence[Places]]


def _of_all(fit: LinearFit, departure: Departure, seen: Sequence[_Seen], several: int) -> list[Found]:
    """All records, where these show a departure together that has one place in each; else none."""
    seen = [one for one in seen if one.places[departure]]
    places = [one.places[departure][0] for one in seen]
    if not places:
        return []
    (score,) = fit.test(Sums.stacked([Sums.side_by_side([one.sums.at(0) for one in places])]))
    if score is None or score.chance * several > FALSE_ALARMS:
        return []
    tests = ((one, there.candidates[0], fit.test(there.sums)[0]) for one, there in zip(seen, places, strict=True))
    return [
        Found(departure, candidate, own, score.chance * several, one.place, one.record)
        for one, candidate, own in tests
        if own is not None
    ]


def _pooled(before: Sequence[Places], more: Sequence[Places]) -> list[Places]:
    """Places whose amounts parts share; none where one part has none."""
    if not before or not more:
        return []
    return [Places(one.candidates, one.sums + other.sums) for one, other in zip(before, more, strict=True)]


@dataclass(frozen=True, eq=False)
class _Test:
    """A candidate that noise does not explain: its sums, its test, and the number of tests that share the rate."""

    candidate: Candidate
    sums: Sums
    score: Score
    several: int


def _sure(
    fit: LinearFit, departure: Departure, places: Sequence[Places], several: int, own: Own | None = None
) -> list[_Test]:
    """The significant candidates, that which explains most first.

    ``several``: other tests that share the rate; ``own``: of the part that the places are in; None where they are in
    all.
    """
    several *= sum(len(some.candidates) for some in places)
    tests = [
        _Test(candidate, some.sums.at(place), score, several)
        for some in places
        for place, (candidate, score) in enumerate(
            zip(some.candidates, _tests(fit, departure, some.sums, own), strict=True)
        )
        if score is not None and score.chance * several < FALSE_ALARMS
    ]
    return sorted(tests, key=lambda test: -test.score.explained)


def _tests(fit: LinearFit, departure: Departure, sums: Sums, own: Own | None) -> list[Score | None]:
    return fit.test(sums.within(own, fit.inverse) if departure.within and own is not None else sums)


def _exactly(fit: LinearFit, departure: Departure, tests: Sequence[_Test], part: Part, scale: Scale) -> list[_Test]:
    """The first candidate that is significant by exact sums, too."""
    for test in tests[:MOST_EXACT]:
        sums = departure.exact(test.candidate, part, scale, len(fit.uncertainty))
        (score,) = _tests(fit, departure, Sums.stacked([sums]), part.own)
        if score is not None and score.chance * test.several < FALSE_ALARMS:
            return [replace(test, sums=sums, score=score)]
    return []


def _best(fit: LinearFit, departure: Departure, tests: Sequence[_Test]) -> tuple[Candidate, Score, float] | None:
    """The first candidate with its test and chance; None of none."""
    if not tests:
        return None
    test, shift = tests[0], tests[0].score.shift
    if departure.own_columns:  # of that significant pair that moves the parameters most
        pairs = [test.sums.some([first, first + 1]) for first in range(0, len(test.sums.score), 2)]
        every = [pair for pair in fit.test(Sums.stacked(pairs)) if pair is not None]
        alone = [pair for pair in every if pair.chance * test.several * len(pairs) < FALSE_ALARMS]
        shift = max((pair.shift for pair in alone), key=fit.impact, default=np.zeros_like(shift))
    return test.candidate, replace(test.score, shift=shift), test.score.chance * test.several

"""What departs from a fit significantly, and how far it moves the parameters.

One rate for all: in a clean calibration noise shows a departure with the chance FALSE_ALARMS, once for the records and
once for points, shared among the kinds, the records and the places of each. The one that explains most becomes a
nuisance parameter, and the others are tested beside it, as a step in time imitates a misfit over frequency, and the
other way round.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, reduce
from operator import add
from typing import TypeGuard

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.candidate import Candidate, Places
from vibrident.fit.departures.departure import Departure, Scale, in_widths
from vibrident.fit.departures.part import Part
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.score import LinearFit, Score, Sums
from vibrident.fit.registry import DEPARTURES
from vibrident.fit.response.response import ComplexArray

#: Chance that noise alone shows any departure in a calibration.
FALSE_ALARMS = 1e-4
#: Bands of like information.
BANDS = 8
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
    parts: Sequence[Part], points: PointsPart | None, uncertainty: FloatArray, *, misfit: bool = False
) -> list[Together]:
    """Every significant departure, the most significant first.

    Args:
        parts: the records of the fit.
        points: its response at points, where that is what was fitted.
        uncertainty: of the coordinates as stated, shape (P,).
        misfit: whether the model does not explain the data: then what explains most is asked for alone.
    """
    rounds = 1 if misfit else ROUNDS
    found = _among_records(list(parts), uncertainty, rounds) if parts else []
    return found + ([] if points is None else _among_points(points, uncertainty, rounds))


def _among_records(parts: list[Part], uncertainty: FloatArray, rounds: int) -> list[Together]:
    """Departures are told apart in the noise that was read without them, which holds what they make of it too."""
    found, fit, scale = list[list[Found]](), LinearFit.of(parts, uncertainty), Scale.of(parts, BANDS)
    first = list(parts)
    for _ in range(rounds):
        now = _strongest(_of_records(fit, parts, scale))
        if not now:
            break
        for place, columns in _columns(now):
            parts[place] = parts[place].beside(columns)
        fit = LinearFit.of(parts, uncertainty)
        found.append(now)
    shifts = cache(lambda: _shifts(first, found, uncertainty))
    return _of_one_kind([_together(now, lambda k=k: shifts()[k]) for k, now in enumerate(found)])


def _columns(found: Sequence[Found]) -> Iterator[tuple[int, FloatArray | ComplexArray]]:
    """Number of a part, and columns of a departure of it."""
    for one in found:
        every = one.candidate.columns()
        yield from zip(range(len(every)) if one.place is None else [one.place], every, strict=True)


def _shifts(parts: list[Part], found: Sequence[Sequence[Found]], uncertainty: FloatArray) -> list[FloatArray]:
    """How far the departures of each round move the coordinates, told in the noise that is left beside them."""
    shifts, before = list[FloatArray](), _optimum(LinearFit.of(parts, uncertainty), parts)
    for now in found:
        for place, columns in _columns(now):
            parts[place] = parts[place].in_noise_beside(columns)
        after = _optimum(LinearFit.of(parts, uncertainty), parts)
        shifts.append(before - after)
        before = after
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
        before = _optimum(fit)
        points = reduce(PointsPart.beside, (np.asarray(one.candidate.columns()[0], float) for one in now), points)
        fit = points.fit(uncertainty)
        found.append(_together(now, partial(np.subtract, before, _optimum(fit))))
    return found


def _together(found: Sequence[Found], moved: Callable[[], FloatArray]) -> Together:
    """``moved``: makes the shift of the fit beside all of them."""
    if not found[0].departure.joint:
        moved = partial(np.sum, [one.score.shift for one in found], axis=0)
    return Together(tuple(found), moved)


def _optimum(fit: LinearFit, parts: Sequence[Part] = ()) -> FloatArray:
    """Where the best coordinates are from those of the fit, shape (P,); ``parts``: those with their own tell theirs."""
    own = [part.pull @ part.inverse @ part.own[0] for part in parts if part.pull is not None]
    return np.sum([fit.inverse @ fit.gradient, *own], axis=0)


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
        best = _best(fit, departure, in_widths(departure.at_points(points)), len(kinds))
        if best is not None:
            found.append(Found(departure, *best, None, best[0].record))
    return found


def _of_records(fit: LinearFit, parts: Sequence[Part], scale: Scale) -> list[Found]:
    kinds, parameters, found = DEPARTURES.all(), len(fit.uncertainty), list[Found]()
    narrow = any(part.optical and part.turns is not None for part in parts)
    for departure in kinds.values():
        if narrow and not departure.of_light:
            continue
        if departure.pooled:
            best = _best(fit, departure, _pooled(departure, parts, scale, parameters), len(kinds))
            found += [] if best is None else [Found(departure, *best, None, None)]
            continue
        every, own = [departure.places(part, scale, parameters) for part in parts], list[Found]()
        shared = len(kinds) * (2 if departure.together else 1)
        for place, (part, places) in enumerate(zip(parts, every, strict=True)):
            inside = partial(Sums.within, part=part, inverse=fit.inverse) if departure.within else None
            best = _best(fit, departure, places, shared * len(parts), inside)
            own += [] if best is None else [Found(departure, *best, place, part.name)]
        alike = _of_all(fit, departure, parts, every, shared) if departure.together else []
        found += alike or own
    return found


def _of_all(
    fit: LinearFit, departure: Departure, parts: Sequence[Part], every: Sequence[Sequence[Places]], several: int
) -> list[Found]:
    """All records, where these show a departure together that has one place in each; else none."""
    own = [places.sums.at(0) for (places,) in every]
    (score,) = fit.test(Sums.stacked([Sums.side_by_side(own)]))
    if score is None or score.chance * several > FALSE_ALARMS:
        return []
    alone = (
        (places.candidates[0], *fit.test(Sums.stacked([sums]))) for (places,), sums in zip(every, own, strict=True)
    )
    return [
        Found(departure, candidate, one, score.chance * several, place, part.name)
        for place, (part, (candidate, one)) in enumerate(zip(parts, alone, strict=True))
        if one is not None
    ]


def _pooled(departure: Departure, parts: Sequence[Part], scale: Scale, parameters: int) -> list[Places]:
    """Places whose amounts all parts share."""
    every = [departure.places(part, scale, parameters) for part in parts]
    if not all(every):
        return []
    return [_joined(each) for each in zip(*every, strict=True)]


def _joined(each: Sequence[Places]) -> Places:
    def one(own: Sequence[Candidate]) -> Candidate:
        return Candidate(own[0].words, lambda: tuple(columns for every in own for columns in every.columns()))

    candidates = zip(*(places.candidates for places in each), strict=True)
    return Places(tuple(one(own) for own in candidates), reduce(add, (places.sums for places in each)))


def _best(
    fit: LinearFit,
    departure: Departure,
    places: Sequence[Places],
    several: int,
    inside: Callable[[Sums], Sums] | None = None,
) -> tuple[Candidate, Score, float] | None:
    """The most significant candidate with its test and chance; None where that is noise.

    ``inside``: makes sums of those beside the record's own parameters.
    """
    several *= sum(len(some.candidates) for some in places)
    seen = inside or (lambda sums: sums)

    def sure(score: Score | None, among: int = 1) -> TypeGuard[Score]:
        return score is not None and score.chance * several * among < FALSE_ALARMS

    tests = [
        (candidate, some.sums.at(place), score)
        for some in places
        for place, (candidate, score) in enumerate(zip(some.candidates, fit.test(seen(some.sums)), strict=True))
        if sure(score)
    ]
    tests.sort(key=lambda test: -test[2].explained)
    for candidate, sums, score in tests[:MOST_EXACT]:
        own = sums if candidate.exactly is None else candidate.exactly()
        exact = score if candidate.exactly is None else fit.test(seen(Sums.stacked([own])))[0]
        if not sure(exact):
            continue
        shift = exact.shift
        if departure.own_columns:  # of that significant pair that moves the parameters most
            pairs = [own.some([first, first + 1]) for first in range(0, len(own.score), 2)]
            alone = [pair for pair in fit.test(Sums.stacked(pairs)) if sure(pair, len(pairs))]
            shift = max((pair.shift for pair in alone), key=fit.impact, default=np.zeros_like(shift))
        return candidate, replace(exact, shift=shift), exact.chance * several
    return None

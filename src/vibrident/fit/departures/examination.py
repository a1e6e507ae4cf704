"""What departs from a fit significantly, and how far it moves the parameters.

One rate for all: in a clean calibration noise shows a departure with the chance FALSE_ALARMS, once for the records and
once for points, shared among the kinds, the records and the places of each. The one that explains most becomes a
nuisance parameter, and the others are tested beside it, as a step in time imitates a misfit over frequency, and the
other way round.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, reduce
from typing import TypeGuard

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.data.records import FloatArray
from vibrident.fit.departures.candidate import Candidate, Places
from vibrident.fit.departures.departure import Departure, Scale, Size, in_widths
from vibrident.fit.departures.part import Own, Part, Parts
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
    parts: Parts, points: PointsPart | None, uncertainty: FloatArray, *, misfit: bool = False
) -> list[Together]:
    """Every significant departure, the most significant first.

    Args:
        parts: the records of the fit.
        points: its response at points, where that is what was fitted.
        uncertainty: of the coordinates as stated, shape (P,).
        misfit: whether the model does not explain the data: then what explains most is asked for alone.
    """
    rounds = 1 if misfit else ROUNDS
    found = _among_records(parts, uncertainty, rounds)
    return found + ([] if points is None else _among_points(points, uncertainty, rounds))


def _among_records(parts: Parts, uncertainty: FloatArray, rounds: int) -> list[Together]:
    """Departures are told apart in the noise that was read without them, which holds what they make of it too."""
    sizes, own, narrow = list[Size](), list[Own](), False
    for part in parts:
        sizes.append(Size.of(part, parts.top_hz))
        own.append(part.own)
        narrow |= part.optical and part.turns is not None
    if not own:
        return []
    found, fit, scale, beside = (
        list[list[Found]](),
        LinearFit.of(own, uncertainty),
        Scale.of(sizes, parts.top_hz, BANDS),
        parts,
    )
    for number in range(1, rounds + 1):
        now = _strongest(_of_records(fit, beside, scale, narrow=narrow))
        if not now:
            break
        found.append(now)
        if number < rounds:
            beside = beside.beside(partial(_columns, now, scale))
            fit = LinearFit.of([part.own for part in beside], uncertainty)
    if rounds == 1:  # parameters of a model that is wrong: the noise beside a departure makes them no truer
        return [_together(now) for now in found]
    shifts = cache(lambda: _shifts(parts, found, scale, uncertainty))
    return _of_one_kind([_together(now, lambda k=k: shifts()[k]) for k, now in enumerate(found)])


def _columns(found: Sequence[Found], scale: Scale, number: int, part: Part) -> list[FloatArray | ComplexArray]:
    """Of the departures of a part."""
    return [one.departure.columns_of(one.candidate, part, scale) for one in found if one.place in (None, number)]


def _shifts(parts: Parts, found: Sequence[Sequence[Found]], scale: Scale, uncertainty: FloatArray) -> list[FloatArray]:
    """How far the departures of each round move the coordinates, by the amounts that all have together.

    In the noise that is left beside them. How far the optimum itself is another one in that noise counts to the first.
    """
    shifts = [np.zeros(len(uncertainty)) for _ in found]
    every = [(number, one) for number, now in enumerate(found) for one in now if not one.departure.own_columns]
    if not every:
        return shifts
    before, beside, own, widths = list[Own](), list[Own](), list[tuple[list[int], Sums]](), dict[int, int]()
    for place, part in enumerate(parts):
        here = [key for key, (_, one) in enumerate(every) if one.place in (None, place)]
        columns = _columns([one for _, one in every], scale, place, part)
        quiet = part.in_noise_beside(columns)
        before.append(part.own)
        beside.append(quiet.own)
        if here:
            widths |= dict(zip(here, map(len, columns), strict=True))
            white = np.concatenate([quiet.white(each) for each in columns])
            own.append((here, Sums.of(quiet, white, len(uncertainty))))
    fit, which = LinearFit.of(beside, uncertainty), np.repeat(sorted(widths), [widths[key] for key in sorted(widths)])
    together = reduce(Sums.__add__, (sums.among(np.isin(which, here)) for here, sums in own))
    for key, moved in zip(which.tolist(), fit.moved(together), strict=True):
        shifts[every[key][0]] += moved
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
        best = _best(fit, departure, in_widths(departure.at_points(points)), len(kinds))
        if best is not None:
            found.append(Found(departure, *best, None, best[0].record))
    return found


def _of_records(fit: LinearFit, parts: Parts, scale: Scale, *, narrow: bool) -> list[Found]:
    """``narrow``: whether the noise of a sine is an interferometer's light."""
    kinds, parameters = DEPARTURES.all(), len(fit.uncertainty)
    looked = [departure for departure in kinds.values() if departure.of_light or not narrow]
    every, own = dict[Departure, list[Places]](), {departure: list[Found]() for departure in looked}
    alike = {departure: list[_InRecord]() for departure in looked if departure.together}
    for place, part in enumerate(parts):
        for departure in looked:
            places = departure.places(part, scale, parameters)
            if departure.pooled:
                every[departure] = _pooled(every[departure], places) if place else places
                continue
            several = len(kinds) * (2 if departure.together else 1)
            best = _best(fit, departure, places, several * scale.parts, part)
            own[departure] += [] if best is None else [Found(departure, *best, place, part.name)]
            if departure.together:
                (one,) = places
                alike[departure].append(_InRecord(place, part.name, one.candidates[0], one.sums.at(0)))
    for departure, places in every.items():
        best = _best(fit, departure, places, len(kinds))
        own[departure] += [] if best is None else [Found(departure, *best, None, None)]
    for departure, records in alike.items():
        own[departure] = _of_all(fit, departure, records, 2 * len(kinds)) or own[departure]
    return [one for some in own.values() for one in some]


@dataclass(frozen=True, eq=False)
class _InRecord:
    """The one place of a departure in a record, and its sums."""

    place: int
    record: str
    candidate: Candidate
    sums: Sums


def _of_all(fit: LinearFit, departure: Departure, records: Sequence[_InRecord], several: int) -> list[Found]:
    """All records, where these show a departure together that has one place in each; else none."""
    (score,) = fit.test(Sums.stacked([Sums.side_by_side([one.sums for one in records])]))
    if score is None or score.chance * several > FALSE_ALARMS:
        return []
    chance = score.chance * several
    alone = ((one, *fit.test(Sums.stacked([one.sums]))) for one in records)
    return [
        Found(departure, one.candidate, own, chance, one.place, one.record) for one, own in alone if own is not None
    ]


def _pooled(before: Sequence[Places], more: Sequence[Places]) -> list[Places]:
    """Places whose amounts parts share; none where one part has none."""
    if not before or not more:
        return []
    return [Places(one.candidates, one.sums + other.sums) for one, other in zip(before, more, strict=True)]


def _best(
    fit: LinearFit,
    departure: Departure,
    places: Sequence[Places],
    several: int,
    part: Part | None = None,
) -> tuple[Candidate, Score, float] | None:
    """The most significant candidate with its test and chance; None where that is noise.

    ``part``: that the places are in; None where they are in all.
    """
    several *= sum(len(some.candidates) for some in places)

    def seen(sums: Sums) -> Sums:
        return sums.within(part, fit.inverse) if departure.within and part is not None else sums

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
        whitened = None if part is None else departure.exact(candidate, part, len(fit.uncertainty))
        own = sums if whitened is None else whitened
        exact = score if whitened is None else fit.test(seen(Sums.stacked([own])))[0]
        if not sure(exact):
            continue
        shift = exact.shift
        if departure.own_columns:  # of that significant pair that moves the parameters most
            pairs = [own.some([first, first + 1]) for first in range(0, len(own.score), 2)]
            alone = [pair for pair in fit.test(Sums.stacked(pairs)) if sure(pair, len(pairs))]
            shift = max((pair.shift for pair in alone), key=fit.impact, default=np.zeros_like(shift))
        return candidate, replace(exact, shift=shift), exact.chance * several
    return None

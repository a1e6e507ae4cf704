"""What departs from a fit significantly, and how far it moves the parameters.

One rate for all: in a clean calibration noise shows a departure with the chance FALSE_ALARMS, once for the records and
once for points, shared among the kinds, the records and the places of each. The one that explains most becomes a
nuisance parameter, and the others are tested beside it, as a step in time imitates a misfit over frequency, and the
other way round.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.fit.departures.departure import Candidate, Departure, Scale
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import PointsPart
from vibrident.fit.departures.score import LinearFit, Own, Sums, shifts_beside
from vibrident.fit.departures.search import Asked, Found, best_of, of_records
from vibrident.fit.registry import DEPARTURES

#: Departures that are looked for beside each other.
ROUNDS = 3
#: Groups of so many samples together are held; of more, each pass makes them anew: a limit of memory.
MAX_HELD = 1 << 19


@dataclass(frozen=True, eq=False)
class Together:
    """Departures of one kind, by record or of all.

    Attributes:
        found: these, the most significant first.
        moved: makes how far they move the coordinates together, and the standard deviation of that, shape (2, P).
    """

    found: tuple[Found, ...]
    moved: Callable[[], FloatArray]

    @cached_property
    def _moved(self) -> FloatArray:
        return self.moved()

    @property
    def shift(self) -> FloatArray:
        """How far they move the coordinates together, shape (P,)."""
        return self._moved[0]

    @property
    def doubt(self) -> FloatArray:
        """Standard deviation of the shift, shape (P,)."""
        return self._moved[1]


@dataclass(frozen=True, eq=False)
class Groups:
    """The groups of a fit, one after the other.

    Attributes:
        make: makes them.
        samples: of all together.
    """

    make: Callable[[], Iterable[WhitenedGroup]]
    samples: int

    @cached_property
    def _held(self) -> list[WhitenedGroup] | None:
        return list(self.make()) if self.samples <= MAX_HELD else None

    def __iter__(self) -> Iterator[WhitenedGroup]:
        return iter(self.make() if self._held is None else self._held)

    def beside(self, found: Sequence[Found], scale: Scale) -> Groups:
        """The groups with departures as nuisance columns."""

        def made() -> Iterator[WhitenedGroup]:
            for group in self:
                rows = _rows(found, group, scale)
                yield group.beside(rows) if rows.shape[1] else group

        return replace(self, make=made)


def examine(
    groups: Groups,
    scale: Scale,
    points: PointsPart | None,
    uncertainty: FloatArray,
    *,
    misfit: bool = False,
) -> list[Together]:
    """Every significant departure, the most significant first.

    Args:
        groups: the records of the fit.
        scale: what they have in common.
        points: its response at points, where that is what was fitted.
        uncertainty: of the coordinates as stated, shape (P,).
        misfit: whether the model does not explain the data: then what explains most is asked for alone.
    """
    rounds = 1 if misfit else ROUNDS
    found = _among_records(groups, scale, uncertainty, rounds)
    return found + ([] if points is None else _among_points(points, uncertainty, rounds))


def _among_records(
    groups: Groups, scale: Scale, uncertainty: FloatArray, rounds: int
) -> list[Together]:
    """Departures are told apart in the noise that was read without them, which holds what they make of it too."""
    found = list[list[Found]]()
    beside = groups
    for _ in range(rounds):
        now = _strongest(of_records(beside, scale, uncertainty))
        if not now:
            break
        found.append(now)
        beside = beside.beside(now, scale)
    if (
        rounds == 1
    ):  # parameters of a model that is wrong: the noise beside a departure makes them no truer
        return [_together(now) for now in found]
    shifts = cache(lambda: _shifts(groups, found, scale, uncertainty))
    return _of_one_kind([_together(now, lambda k=k: shifts()[k]) for k, now in enumerate(found)])


def _rows(found: Sequence[Found], group: WhitenedGroup, scale: Scale) -> FloatArray:
    """Whitened columns of departures in each record of a group, shape (R, m, 2 K); zero where a record has fewer."""
    return _side_by_side(
        found, group, lambda one, part: one.departure.whitened(one.candidate, part, scale)
    )


def _side_by_side(
    found: Sequence[Found],
    group: WhitenedGroup,
    make: Callable[[Found, WhitenedGroup], NDArray[Any]],
) -> NDArray[Any]:
    """What is made of departures for each record that has them, shape (R, m, …); zero where a record has fewer."""
    every = [list[NDArray[Any]]() for _ in group.records]
    places = group.numbers.tolist()
    for one in found:
        if one.place is None:
            for own, rows in zip(every, make(one, group), strict=True):
                own.append(rows)
        elif one.place in places:
            at = places.index(one.place)
            every[at].append(make(one, group.only([at]))[0])
    joined = [np.concatenate(rows) if rows else None for rows in every]
    sizes = [0 if rows is None else len(rows) for rows in joined]
    shape, kind = next(
        ((rows.shape[1:], rows.dtype) for rows in joined if rows is not None), ((0,), float)
    )
    made = np.zeros((len(every), max(sizes), *shape), dtype=kind)
    for row, size, rows in zip(made, sizes, joined, strict=True):
        row[:size] = 0.0 if rows is None else rows
    return made


def _shifts(
    groups: Groups, found: Sequence[Sequence[Found]], scale: Scale, uncertainty: FloatArray
) -> list[FloatArray]:
    """How far the departures of each round move the coordinates, by the amounts that all have together.

    In the noise that is left beside them, and by amounts of each record's own: what only looks alike in all, as a level
    that each record exceeds by its own part, moves each by its own. Where they are alike this costs no precision. How
    far the optimum itself is another one in that noise counts to the first. The amounts have a prior, which keeps what
    they move within reason: no doubt of it is told.
    """
    shifts = [np.zeros((2, len(uncertainty))) for _ in found]
    every = [
        (number, one)
        for number, now in enumerate(found)
        for one in now
        if not one.departure.own_columns
    ]
    if not every:
        return shifts
    before = list[Own]()
    beside = list[Own]()
    own = list[Sums]()
    sizes = list[FloatArray]()
    rounds = list[list[int]]()
    alone = [one for _, one in every]
    for group in groups:
        columns = _side_by_side(
            alone,
            group,
            lambda one, part: _each(one.departure.columns_of(one.candidate, part, scale), part),
        )
        quiet = group.again(columns) if columns.shape[1] else group
        before.append(group.own)
        beside.append(quiet.own)
        if not columns.shape[1]:
            continue
        sums = quiet.sums(_rows(alone, quiet, scale)[:, None]).at((slice(None), 0))
        for at, place in enumerate(group.numbers.tolist()):
            here = [(number, one) for number, one in every if one.place in (None, place)]
            amounts = [np.abs(one.score.amounts) for _, one in here]
            if here:
                sizes.append(np.concatenate(amounts))
                own.append(sums.at(at).some(range(sizes[-1].size)))
                rounds.append(
                    np.repeat(
                        [number for number, _ in here], [part.size for part in amounts]
                    ).tolist()
                )
    fit = LinearFit.of(Own.joined(beside), uncertainty)
    for numbers, moved in zip(rounds, shifts_beside(fit, own, sizes), strict=True):
        for number, shift in zip(numbers, moved, strict=True):
            shifts[number][0] += shift
    shifts[every[0][0]][0] += LinearFit.of(Own.joined(before), uncertainty).optimum - fit.optimum
    return shifts


def _each(columns: NDArray[Any], group: WhitenedGroup) -> NDArray[Any]:
    """Columns for each record of a group, which may share them."""
    return np.broadcast_to(columns, (len(group.records), *columns.shape[1:]))


def _of_one_kind(every: list[Together]) -> list[Together]:
    """Those of a kind told record by record are one, whatever the round, as some records show it better than others.

    So are those of a family.
    """
    kinds = dict[Departure | int | str, list[Together]]()
    for number, one in enumerate(every):
        departure = one.found[0].departure
        kinds.setdefault(
            departure.family or (number if departure.pooled else departure), []
        ).append(one)
    return [_joined_groups(some) for some in kinds.values()]


def _joined_groups(some: Sequence[Together]) -> Together:
    found = tuple(one for group in some for one in group.found)

    def moved() -> FloatArray:
        doubt = np.max([group.doubt for group in some], axis=0)
        return np.stack([np.sum([group.shift for group in some], axis=0), doubt])

    return Together(found, moved)


def _together(found: Sequence[Found], moved: Callable[[], FloatArray] | None = None) -> Together:
    """``moved``: makes the shift of the fit beside all of them; None: as each of them shows it."""
    if moved is None or not found[0].departure.joint:
        shift, doubt = (
            np.array([getattr(one.score, name) for one in found]) for name in ("shift", "doubt")
        )
        moved = partial(np.stack, [np.sum(shift, axis=0), np.sqrt(np.sum(doubt**2, axis=0))])
    return Together(tuple(found), moved)


def _strongest(found: Sequence[Found]) -> list[Found]:
    """The departure that explains most; where that is of records, in all in which it is."""
    if not found:
        return []
    kinds = {one.departure for one in found}
    explained = {
        kind: sum(one.score.explained for one in found if one.departure is kind) for kind in kinds
    }
    best = max(explained, key=lambda kind: explained[kind])
    return sorted(
        (one for one in found if one.departure is best), key=lambda one: -one.score.explained
    )


def _among_points(points: PointsPart, uncertainty: FloatArray, rounds: int) -> list[Together]:
    """Departures of a response at points; their sums need no bound."""
    made = list[Together]()
    fit = points.fit(uncertainty)
    kinds = DEPARTURES.all()
    for _ in range(rounds):
        found = list[tuple[Found, PointsPart]]()
        for departure in kinds.values():
            places = departure.at_points(points)
            asked = Asked(departure, None, None, len(kinds) * len(places))
            asked.tested = [(Candidate(place.words), points.sums(place)) for place in places]
            best = best_of(fit, asked)
            if best is not None:
                place = places[asked.chosen]
                found.append((replace(best, record=place.record), points.beside(place)))
        if not found:
            break
        strongest, beside = max(found, key=lambda one: one[0].score.explained)
        before = fit
        points = beside
        fit = points.fit(uncertainty)
        more = np.diag(fit.inverse) - np.diag(before.inverse)  # Hausman 1978
        doubt = np.sqrt(np.maximum(more, 0.0))
        made.append(
            _together([strongest], partial(np.stack, [before.optimum - fit.optimum, doubt]))
        )
    return made

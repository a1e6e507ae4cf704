"""Significant departures from a fit, and how far they move the parameters.

One rate for all: in a clean calibration noise shows a departure with the chance FALSE_ALARMS, once
for the records and once for points, shared among the kinds, the records and the places of each. The
one that explains most becomes a nuisance parameter, and the others are tested beside it, as a step
in time imitates a misfit over frequency, and the other way round.
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
from vibrident.fit.departures.score import LinearFit, RecordInformation, Sums, shifts_beside
from vibrident.fit.departures.search import PendingTest, SignificantDeparture, best_of, of_records
from vibrident.fit.registry import DEPARTURES

#: Departures that are looked for beside each other.
MAX_ROUNDS = 3
#: Groups of so many samples together are held; of more, each pass makes them anew, for memory.
MAX_SAMPLES_HELD = 1 << 19


@dataclass(frozen=True, eq=False)
class DepartureGroup:
    """Departures of one kind, by record or of all.

    Attributes:
        departures: these, the most significant first.
        move: makes how far they move the coordinates together, and the standard deviation of that,
            shape (2, P).
    """

    departures: tuple[SignificantDeparture, ...]
    move: Callable[[], FloatArray]

    @cached_property
    def _shift_and_doubt(self) -> FloatArray:
        """Return shift and doubt, shape (2, P)."""
        return self.move()

    @property
    def shift(self) -> FloatArray:
        """Return how far they move the coordinates together, shape (P,)."""
        return self._shift_and_doubt[0]

    @property
    def doubt(self) -> FloatArray:
        """Return the standard deviation of the shift, shape (P,)."""
        return self._shift_and_doubt[1]


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
        """Return all groups where they are held, or None where each pass makes them."""
        return list(self.make()) if self.samples <= MAX_SAMPLES_HELD else None

    def __iter__(self) -> Iterator[WhitenedGroup]:
        return iter(self.make() if self._held is None else self._held)

    def with_nuisances(self, departures: Sequence[SignificantDeparture], scale: Scale) -> Groups:
        """Return the groups with departures as nuisance columns."""

        def groups_with_nuisances() -> Iterator[WhitenedGroup]:
            for group in self:
                rows = _rows(departures, group, scale)
                yield group.with_nuisances(rows) if rows.shape[1] else group

        return replace(self, make=groups_with_nuisances)


def examine(
    groups: Groups,
    scale: Scale,
    points: PointsPart | None,
    uncertainty: FloatArray,
    *,
    misfit: bool = False,
) -> list[DepartureGroup]:
    """Return every significant departure, the most significant first.

    Args:
        groups: the records of the fit.
        scale: what they have in common.
        points: its response at points, where that is what was fitted.
        uncertainty: of the coordinates as stated, shape (P,).
        misfit: whether the model does not explain the data: then what explains most is asked for
            alone.
    """
    rounds = 1 if misfit else MAX_ROUNDS
    in_records = _among_records(groups, scale, uncertainty, rounds)
    return in_records + ([] if points is None else _among_points(points, uncertainty, rounds))


def _among_records(
    groups: Groups, scale: Scale, uncertainty: FloatArray, rounds: int
) -> list[DepartureGroup]:
    """Return departures of records, tested in the noise that was read without them.

    That noise holds what they make of it too.
    """
    by_round = list[list[SignificantDeparture]]()
    groups_with_nuisances = groups
    for _ in range(rounds):
        strongest = _strongest(of_records(groups_with_nuisances, scale, uncertainty))
        if not strongest:
            break
        by_round.append(strongest)
        groups_with_nuisances = groups_with_nuisances.with_nuisances(strongest, scale)
    if rounds == 1:
        # Parameters of a model that is wrong: the noise beside a departure makes them no truer.
        return [_group_of_kind(strongest) for strongest in by_round]
    shifts = cache(lambda: _shifts(groups, by_round, scale, uncertainty))
    return _join_kinds(
        [_group_of_kind(strongest, lambda k=k: shifts()[k]) for k, strongest in enumerate(by_round)]
    )


def _rows(
    departures: Sequence[SignificantDeparture], group: WhitenedGroup, scale: Scale
) -> FloatArray:
    """Return whitened columns of departures in each record of a group, shape (R, m, 2 K).

    They are zero where a record has fewer.
    """
    return _stack_by_record(
        departures,
        group,
        lambda departure, members: departure.kind.whitened(departure.candidate, members, scale),
    )


def _stack_by_record(
    departures: Sequence[SignificantDeparture],
    group: WhitenedGroup,
    make: Callable[[SignificantDeparture, WhitenedGroup], NDArray[Any]],
) -> NDArray[Any]:
    """Return what is made of departures for each record that has them, shape (R, m, …).

    It is zero where a record has fewer.
    """
    parts_by_record = [list[NDArray[Any]]() for _ in group.records]
    places = group.numbers.tolist()
    for departure in departures:
        if departure.place is None:
            for parts, rows in zip(parts_by_record, make(departure, group), strict=True):
                parts.append(rows)
        elif departure.place in places:
            position = places.index(departure.place)
            parts_by_record[position].append(make(departure, group.subset([position]))[0])
    joined = [np.concatenate(rows) if rows else None for rows in parts_by_record]
    sizes = [0 if rows is None else len(rows) for rows in joined]
    shape, kind = next(
        ((rows.shape[1:], rows.dtype) for rows in joined if rows is not None), ((0,), float)
    )
    stacked = np.zeros((len(parts_by_record), max(sizes), *shape), dtype=kind)
    for row, size, rows in zip(stacked, sizes, joined, strict=True):
        row[:size] = 0.0 if rows is None else rows
    return stacked


def _shifts(
    groups: Groups,
    by_round: Sequence[Sequence[SignificantDeparture]],
    scale: Scale,
    uncertainty: FloatArray,
) -> list[FloatArray]:
    """Return how far the departures of each round move the coordinates, each of shape (2, P).

    They do so by the amounts that all have together, in the noise that is left beside them, and by
    amounts of each record's own: what only looks alike in all, as a level that each record exceeds
    by its own part, moves each by its own. Where they are alike this costs no precision. How far
    the optimum itself is another one in that noise counts to the first. The amounts have a prior,
    which keeps what they move within reason: no doubt of it is stated.
    """
    shifts = [np.zeros((2, len(uncertainty))) for _ in by_round]
    entries = [
        (number, departure)
        for number, departures in enumerate(by_round)
        for departure in departures
        if not departure.kind.own_columns
    ]
    if not entries:
        return shifts
    information = list[RecordInformation]()
    information_beside = list[RecordInformation]()
    sums_by_record = list[Sums]()
    sizes = list[FloatArray]()
    rounds = list[list[int]]()
    departures = [departure for _, departure in entries]
    for group in groups:
        columns = _stack_by_record(
            departures,
            group,
            lambda departure, members: _for_each_record(
                departure.kind.columns_of(departure.candidate, members, scale), members
            ),
        )
        group_beside = group.again(columns) if columns.shape[1] else group
        information.append(group.information)
        information_beside.append(group_beside.information)
        if not columns.shape[1]:
            continue
        sums = group_beside.sums(_rows(departures, group_beside, scale)[:, None]).at(
            (slice(None), 0)
        )
        for row, place in enumerate(group.numbers.tolist()):
            entries_here = [
                (number, departure)
                for number, departure in entries
                if departure.place in (None, place)
            ]
            amounts = [np.abs(departure.score.amounts) for _, departure in entries_here]
            if entries_here:
                sizes.append(np.concatenate(amounts))
                sums_by_record.append(sums.at(row).of_columns(range(sizes[-1].size)))
                rounds.append(
                    np.repeat(
                        [number for number, _ in entries_here],
                        [record_amounts.size for record_amounts in amounts],
                    ).tolist()
                )
    fit = LinearFit.from_records(RecordInformation.joined(information_beside), uncertainty)
    for numbers, shifts_of_record in zip(
        rounds, shifts_beside(fit, sums_by_record, sizes), strict=True
    ):
        for number, shift in zip(numbers, shifts_of_record, strict=True):
            shifts[number][0] += shift
    shifts[entries[0][0]][0] += (
        LinearFit.from_records(RecordInformation.joined(information), uncertainty).optimum
        - fit.optimum
    )
    return shifts


def _for_each_record(columns: NDArray[Any], group: WhitenedGroup) -> NDArray[Any]:
    """Return columns for each record of a group, which may share them."""
    return np.broadcast_to(columns, (len(group.records), *columns.shape[1:]))


def _join_kinds(groups: list[DepartureGroup]) -> list[DepartureGroup]:
    """Return one group for each kind tested record by record, and for each family.

    The round does not matter, as some records show a kind better than others.
    """
    kinds = dict[Departure | int | str, list[DepartureGroup]]()
    for number, group in enumerate(groups):
        departure = group.departures[0].kind
        kinds.setdefault(
            departure.family or (number if departure.pooled else departure), []
        ).append(group)
    return [_join_groups(groups_of_kind) for groups_of_kind in kinds.values()]


def _join_groups(groups: Sequence[DepartureGroup]) -> DepartureGroup:
    """Return several groups as one: their shifts add up, and the largest doubt counts."""
    departures = tuple(departure for group in groups for departure in group.departures)

    def move() -> FloatArray:
        doubt = np.max([group.doubt for group in groups], axis=0)
        return np.stack([np.sum([group.shift for group in groups], axis=0), doubt])

    return DepartureGroup(departures, move)


def _group_of_kind(
    departures: Sequence[SignificantDeparture], move: Callable[[], FloatArray] | None = None
) -> DepartureGroup:
    """Return departures of one kind as a group.

    ``move``: makes the shift of the fit beside all of them; None: as each of them shows it.
    """
    if move is None or not departures[0].kind.joint:
        shift, doubt = (
            np.array([getattr(departure.score, name) for departure in departures])
            for name in ("shift", "doubt")
        )
        move = partial(np.stack, [np.sum(shift, axis=0), np.sqrt(np.sum(doubt**2, axis=0))])
    return DepartureGroup(tuple(departures), move)


def _strongest(departures: Sequence[SignificantDeparture]) -> list[SignificantDeparture]:
    """Return the departure that explains most; where that is of records, in all that have it.

    Of records that are compared with each other it is in one: it moves what the others are compared
    with.
    """
    by_kind: dict[Departure, list[SignificantDeparture]] = {}
    for departure in sorted(departures, key=lambda departure: -departure.score.explained):
        by_kind.setdefault(departure.kind, []).append(departure)
    candidates = [
        of_kind[:1] if kind.compares_records else of_kind for kind, of_kind in by_kind.items()
    ]
    return max(
        candidates,
        key=lambda of_kind: sum(departure.score.explained for departure in of_kind),
        default=[],
    )


def _among_points(points: PointsPart, uncertainty: FloatArray, rounds: int) -> list[DepartureGroup]:
    """Return departures of a response at points; their sums need no bound."""
    groups = list[DepartureGroup]()
    fit = points.fit(uncertainty)
    kinds = DEPARTURES.all()
    for _ in range(rounds):
        candidates = list[tuple[SignificantDeparture, PointsPart]]()
        for departure in kinds.values():
            places = departure.at_points(points)
            pending = PendingTest(departure, None, None, len(kinds) * len(places))
            pending.tested = [(Candidate(place.words), points.sums(place)) for place in places]
            best = best_of(fit, pending)
            if best is not None:
                place = places[pending.chosen]
                candidates.append(
                    (replace(best, record=place.record), points.with_nuisances(place))
                )
        if not candidates:
            break
        strongest, points_beside = max(
            candidates, key=lambda candidate: candidate[0].score.explained
        )
        fit_before = fit
        points = points_beside
        fit = points.fit(uncertainty)
        variance_added = np.diag(fit.inverse) - np.diag(fit_before.inverse)  # Hausman 1978
        doubt = np.sqrt(np.maximum(variance_added, 0.0))
        groups.append(
            _group_of_kind(
                [strongest], partial(np.stack, [fit_before.optimum - fit.optimum, doubt])
            )
        )
    return groups

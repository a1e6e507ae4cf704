"""Compute the statistics of a fleet's table: distributions, outliers and yield."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.base.fields import NamedTexts
from vibrident.data.records import BoolArray, FloatArray
from vibrident.lab.fleet.limits import Limit, Specification
from vibrident.lab.fleet.row import IDENTIFIED
from vibrident.lab.fleet.table import Tally

MIN_OUTLIER_VALUES = 20  # in which outliers are searched for
FALSE_ALARM = 0.01  # probability of that search, for a normal distribution of any size
#: Standard deviation of a normal distribution over its median absolute deviation.
SD_PER_MAD = 1.482602218505602
#: The spread of n values is uncertain: the limit is wider by 1 + SMALL_COUNT_FACTOR / n, by
#: simulation.
SMALL_COUNT_FACTOR = 12.0
MAX_GROUPS = 12  # on the page
MAX_OUTLIERS = 200  # in the list
_LIMIT_MARGIN = 0.06  # drawn outside a limit, in units of the width between the limits
_MIN_BINS = 8  # of a histogram
_MAX_BINS = 48


@dataclass(frozen=True, eq=False)
class Histogram:
    """Counts between edges, and counts outside the ends; shapes (bins + 1,) and (bins,)."""

    edges: FloatArray
    counts: NDArray[np.intp]
    below: int
    above: int


@dataclass(frozen=True, eq=False)
class Distribution:
    """Distribution of a parameter in a group."""

    parameter: str
    unit: str  # of all that follows
    count: int  # of the values
    median: float
    sd: float
    least: float
    greatest: float
    median_u: float | None  # of the standard uncertainties; None if none is stated
    histogram: Histogram
    limit: Limit | None  # in that unit; None if there is none, or it cannot be converted
    conforming: int  # values within the limit
    certain: int  # values whose verdict holds for all values within U
    capability: float | None  # Cpk: mean to nearer limit, in units of 3 sd; None without a limit


@dataclass(frozen=True, eq=False)
class FleetGroup:
    """Sensors of one type, one model and one set of units."""

    type: str | None
    model: str
    count: int
    distributions: tuple[Distribution, ...]


@dataclass(frozen=True)
class FleetOutlier:
    """Outlier, or value that does not conform."""

    row: int  # number in the table
    parameter: str
    unit: str  # of value and u
    value: float
    u: float | None  # standard uncertainty; None if it is not stated
    distance: float  # from the median, in robust standard deviations
    outside: bool  # whether it lies outside a limit


@dataclass(frozen=True)
class Yield:
    """Conforming sensors of a type.

    They are within all its limits or, if it has none, identified without a warning.
    """

    type: str | None
    calibrations: int
    identified: int
    conforming: int
    certain: int


@dataclass(frozen=True, eq=False)
class Statistics:
    """Statistics of a fleet."""

    groups: tuple[FleetGroup, ...]  # the largest first
    hidden_groups: int  # number of groups that are not shown
    outliers: tuple[FleetOutlier, ...]  # the farthest first
    hidden_outliers: int  # number of outliers that are not listed
    yields: tuple[Yield, ...]  # by type, the most calibrations first
    limited: bool  # whether any limit applies


def statistics(table: Path, tally: Tally, specification: Specification) -> Statistics:
    """Return the statistics of a fleet's table.

    Args:
        table: the file.
        tally: counts of its rows.
        specification: limits of the parameters, by type.
    """
    columns = _Columns(table)
    identified = columns.is_text("status", IDENTIFIED)
    types = columns.codes("type")
    models = columns.codes("model")
    kinds, group_of_row = _group_rows((types.numbers, models.numbers, tally.units_of), identified)
    group_types = [types.name(number) for number in kinds[0].tolist()]
    all_units = tally.units
    group_units = [all_units[number] for number in kinds[2].tolist()]
    shown = range(min(len(group_units), MAX_GROUPS))
    distributions: list[list[Distribution]] = [[] for _ in shown]
    outliers: list[FleetOutlier] = []
    verdict = _LimitVerdict(identified, group_of_row)
    for parameter in columns.parameters:
        values = columns.numbers(parameter)
        u = columns.numbers(f"{parameter}_u")
        limits = [
            _GroupLimit.of(specification, type_name, parameter, units)
            for type_name, units in zip(group_types, group_units, strict=True)
        ]
        verdict.judge(values, u, limits)
        for group in shown:
            rows = np.flatnonzero((group_of_row == group) & np.isfinite(values))
            if rows.size:
                unit = group_units[group].get(parameter, "")
                limit = limits[group].limit
                distributions[group].append(
                    _distribution(parameter, unit, values[rows], u[rows], limit)
                )
                outliers += _outliers(parameter, unit, rows, values[rows], u[rows], limit)
    outliers.sort(key=lambda outlier: (not outlier.outside, -outlier.distance, outlier.row))
    sizes = np.bincount(group_of_row[identified], minlength=len(group_units))
    groups = [
        FleetGroup(
            group_types[group],
            models.name(int(kinds[1, group])) or "",
            int(sizes[group]),
            tuple(distributions[group]),
        )
        for group in shown
    ]
    return Statistics(
        tuple(groups),
        len(group_units) - len(groups),
        tuple(outliers[:MAX_OUTLIERS]),
        max(0, len(outliers) - MAX_OUTLIERS),
        tuple(_yields(types, identified, *verdict.conforming_rows(columns.sound()))),
        bool(verdict.limited.any()),
    )


def _group_rows(
    columns: tuple[NDArray[np.int32], ...], identified: BoolArray
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Group the identified rows that agree in all columns.

    Args:
        columns: numbers of the rows' values, −1 where there is none; each of shape (rows,).
        identified: shape (rows,).

    Returns:
        The values of each group, the largest group first, shape (columns, groups); and the group of
        each row, −1 if it is not identified, shape (rows,).
    """
    sizes = tuple(int(column.max(initial=-1)) + 2 for column in columns)
    kind = np.ravel_multi_index(tuple(column[identified] + 1 for column in columns), sizes)
    distinct, index, counts = np.unique(kind, return_inverse=True, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    rank = np.empty(order.size, dtype=np.int32)
    rank[order] = np.arange(order.size)
    group = np.full(identified.size, -1, dtype=np.int32)
    group[identified] = rank[index]
    return np.stack(np.unravel_index(distinct[order], sizes)) - 1, group


class _LimitVerdict:
    """Verdict of the limits on every row.

    Attributes:
        limited: whether a limit applies to a row, shape (rows,).
    """

    def __init__(self, identified: BoolArray, group: NDArray[np.int32]) -> None:
        self._identified = identified
        self._group = group
        self._conforming = identified.copy()
        self._certain = identified.copy()
        self.limited = np.zeros(identified.size, dtype=bool)

    def judge(self, values: FloatArray, u: FloatArray, limits: Sequence[_GroupLimit]) -> None:
        """Judge one parameter of all rows by the limit of each row's group.

        A row does not conform to a limit that cannot be used.
        """
        for number, of_group in enumerate(limits):
            in_group = self._group == number
            limit = of_group.limit
            if of_group.is_unusable:
                self.limited |= in_group
                self._conforming[in_group] = False
                self._certain[in_group] = False
            if limit is not None:
                conforms = limit.inside(values[in_group])
                self.limited |= in_group
                self._conforming[in_group] &= conforms
                self._certain[in_group] &= conforms & limit.certain(values[in_group], u[in_group])

    def conforming_rows(self, sound: BoolArray) -> tuple[BoolArray, BoolArray]:
        """Return the rows that conform, and those that conform for all values within U.

        A row without limits conforms if it is identified and sound.
        """
        unlimited = self._identified & sound
        return (
            np.where(self.limited, self._conforming, unlimited),
            np.where(self.limited, self._certain, unlimited),
        )


def outlier_limit(count: int) -> float:
    """Return the smallest distance of an outlier among ``count`` values from their median.

    It is in robust standard deviations.
    """
    return NormalDist().inv_cdf(1 - FALSE_ALARM / (2 * count)) * (1 + SMALL_COUNT_FACTOR / count)


@dataclass(frozen=True)
class _GroupLimit:
    """Limit of a parameter for a group of sensors, in the unit of their values.

    Attributes:
        limit: None if there is none, or it is in a unit that cannot be converted.
        is_unusable: whether there is one in such a unit.
    """

    limit: Limit | None
    is_unusable: bool

    @classmethod
    def of(
        cls, specification: Specification, type_name: str | None, parameter: str, units: NamedTexts
    ) -> _GroupLimit:
        """Find the limit of a parameter, and convert it."""
        stated = specification.limit(type_name, parameter)
        unit = units.get(parameter)
        if stated is None or unit is None:
            return cls(None, is_unusable=False)
        limit = stated.in_unit(unit)
        return cls(limit, is_unusable=limit is None)


def _distribution(
    parameter: str, unit: str, values: FloatArray, u: FloatArray, limit: Limit | None
) -> Distribution:
    finite_u = u[np.isfinite(u)]
    mean = float(np.mean(values))
    sd = float(np.std(values, ddof=1)) if values.size > 1 else 0.0
    capability = None
    conforming = 0
    certain = 0
    if limit is not None:
        conforming = int(limit.inside(values).sum())
        certain = int(limit.certain(values, u).sum())
        capability = min(limit.upper - mean, mean - limit.lower) / (3 * sd) if sd > 0 else None
    return Distribution(
        parameter=parameter,
        unit=unit,
        count=values.size,
        median=float(np.median(values)),
        sd=sd,
        least=float(values.min()),
        greatest=float(values.max()),
        median_u=float(np.median(finite_u)) if finite_u.size else None,
        histogram=_histogram(values, limit),
        limit=limit,
        conforming=conforming,
        certain=certain,
        capability=capability,
    )


def _histogram(values: FloatArray, limit: Limit | None) -> Histogram:
    """Return a histogram over the central values and the limit (Freedman & Diaconis 1981).

    Values outside it are counted separately.
    """
    low, first, third, high = map(float, np.quantile(values, [0.0, 0.25, 0.75, 1.0]))
    spread = third - first
    if spread > 0:
        low = max(low, first - 4 * spread)
        high = min(high, third + 4 * spread)
    if limit is not None and spread > 0:  # a limit far from the values is not drawn
        margin = _LIMIT_MARGIN * (limit.upper - limit.lower)
        low = min(low, max(limit.lower - margin, first - 12 * spread))
        high = max(high, min(limit.upper + margin, third + 12 * spread))
    if not high > low:
        margin = 0.01 * abs(low) or 1.0
        low = low - margin
        high = high + margin
    width = 2 * spread / values.size ** (1 / 3)
    bins = math.ceil((high - low) / width) if width > 0 else _MIN_BINS
    counts, edges = np.histogram(values, min(max(bins, _MIN_BINS), _MAX_BINS), (low, high))
    return Histogram(edges, counts, int((values < low).sum()), int((values > high).sum()))


def _outliers(
    parameter: str,
    unit: str,
    rows: NDArray[np.intp],
    values: FloatArray,
    u: FloatArray,
    limit: Limit | None,
) -> list[FleetOutlier]:
    """Return the outliers of a group, and its values outside the limit.

    Args:
        parameter: its name.
        unit: of the values.
        rows: their numbers in the table, shape (n,).
        values: of the parameter, shape (n,).
        u: standard uncertainties, NaN where not stated, shape (n,).
        limit: for the values; None if there is none.
    """
    deviation = np.abs(values - np.median(values))
    spread = SD_PER_MAD * float(np.median(deviation))
    distance = deviation / spread if spread > 0 else np.zeros(rows.size)
    is_outside = np.zeros(rows.size, dtype=bool) if limit is None else ~limit.inside(values)
    is_listed = is_outside
    if rows.size >= MIN_OUTLIER_VALUES:
        is_listed = is_outside | (distance > outlier_limit(rows.size))
    return [
        FleetOutlier(
            row=int(rows[i]),
            parameter=parameter,
            unit=unit,
            value=float(values[i]),
            u=float(u[i]) if np.isfinite(u[i]) else None,
            distance=float(distance[i]),
            outside=bool(is_outside[i]),
        )
        for i in np.flatnonzero(is_listed)
    ]


def _yields(
    types: _Codes,
    identified: BoolArray,
    conforming: BoolArray,
    certain: BoolArray,
) -> list[Yield]:
    """Return the yield of each type, the one with most calibrations first."""
    numbers, index = np.unique(types.numbers, return_inverse=True)
    flags = (np.ones_like(identified), identified, conforming, certain)
    counts = np.array([np.bincount(index, weights=rows) for rows in flags]).astype(int)
    yields = [
        Yield(types.name(int(number)), *row)
        for number, row in zip(numbers, counts.T.tolist(), strict=True)
    ]
    return sorted(yields, key=lambda group: -group.calibrations)


@dataclass(frozen=True, eq=False)
class _Codes:
    """Column of texts as numbers, shape (rows,)."""

    numbers: NDArray[np.int32]
    texts: Sequence[str]

    def name(self, number: int) -> str | None:
        return self.texts[number] if number >= 0 else None


class _Columns:
    """Columns of the table, each read when it is used."""

    def __init__(self, path: Path) -> None:
        import pyarrow.parquet as pq

        self._file = pq.ParquetFile(path, read_dictionary=["status", "type", "model"])
        names = self._file.schema_arrow.names
        self.parameters = [name for name in names if f"{name}_u" in names]

    def _column(self, name: str) -> Any:
        return self._file.read([name])[name].combine_chunks()

    def numbers(self, name: str) -> FloatArray:
        """Return a column of numbers, NaN where there is none."""
        return np.array(self._column(name).to_numpy(zero_copy_only=False), dtype=float)

    def sound(self) -> BoolArray:
        """Return the rows whose model is adequate, without a warning."""
        adequate = self._column("adequate").fill_null(False)
        warnings = self._column("warnings")
        count = warnings.value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
        return adequate.to_numpy(zero_copy_only=False) & (count == 0)

    def is_text(self, name: str, text: str) -> BoolArray:
        """Return the rows with this text in a column."""
        codes = self.codes(name)
        is_text = np.array([*(known_text == text for known_text in codes.texts), False])
        return is_text[codes.numbers]  # −1 takes the last

    def codes(self, name: str) -> _Codes:
        column = self._column(name)
        return _Codes(
            column.indices.fill_null(-1).to_numpy(zero_copy_only=False),
            column.dictionary.to_pylist(),
        )

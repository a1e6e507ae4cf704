"""Statistics of a fleet's table: distributions, outliers and yield."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
FloatArray = NDArray[np.float64]


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

    parameter: str  # its name
    unit: str  # of all that follows
    count: int  # values
    # median, sd, least, greatest: of the values
    median: float
    sd: float
    least: float
    greatest: float
    median_u: float | None  # of the standard uncertainties; None if no uncertainty is stated
    histogram: Histogram  # of the values
    limit: Limit | None  # for these values; None if there is no limit, or it is in another unit
    conforming: int  # values within the limit
    certain: int  # verdicts that hold for all values within U
    # Cpk, the distance of the mean from the nearer limit in units of 3 sd; None without a limit
    capability: float | None


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
    parameter: str  # its name
    unit: str  # of value and u
    value: float  # of the parameter
    u: float | None  # its standard uncertainty; None if it is not stated
    distance: float  # from the median, in robust standard deviations
    outside: bool  # it does not conform to a limit


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
    more: int  # groups that are not shown
    outliers: tuple[FleetOutlier, ...]  # the farthest first
    more_outliers: int  # that are not listed
    yields: tuple[Yield, ...]  # by type, in the order of their numbers
    limited: bool  # whether any limit applies


def statistics(table: Path, tally: Tally, specification: Specification) -> Statistics:
    """Read a fleet's table and count."""
    columns = _Columns(table)
    identified = columns.is_text("status", IDENTIFIED)
    types = columns.codes("type")
    models = columns.codes("model")
    kinds, group = _grouped((types.numbers, models.numbers, tally.units_of), identified)
    sets = tally.units
    units = [sets[number] for number in kinds[2].tolist()]
    sizes = np.bincount(group[identified], minlength=len(units))
    distributions_of: list[list[Distribution]] = [[] for _ in units[:MAX_GROUPS]]
    outliers: list[FleetOutlier] = []
    verdict = _LimitVerdict(identified, group)
    for parameter in columns.parameters:
        values = columns.numbers(parameter)
        u = columns.numbers(f"{parameter}_u")
        limits = [
            _limit(specification, types.name(number), parameter, unit)
            for number, unit in zip(kinds[0].tolist(), units, strict=True)
        ]
        verdict.judge(values, u, limits)
        for number, distributions in enumerate(distributions_of):
            rows = np.flatnonzero((group == number) & np.isfinite(values))
            if rows.size:
                unit = units[number].get(parameter, "")
                distributions.append(
                    _distribution(parameter, unit, values[rows], u[rows], limits[number])
                )
                outliers += _outliers(parameter, unit, rows, values, u, limits[number])
    outliers.sort(key=lambda outlier: (not outlier.outside, -outlier.distance, outlier.row))
    groups = [
        FleetGroup(
            types.name(int(kinds[0, number])),
            models.name(int(kinds[1, number])) or "",
            int(sizes[number]),
            tuple(outlier),
        )
        for number, outlier in enumerate(distributions_of)
    ]
    return Statistics(
        tuple(groups),
        len(units) - len(groups),
        tuple(outliers[:MAX_OUTLIERS]),
        max(0, len(outliers) - MAX_OUTLIERS),
        tuple(_yields(types, identified, *verdict.of_all(columns.sound()))),
        bool(verdict.limited.any()),
    )


def _grouped(
    columns: tuple[NDArray[np.int32], ...], identified: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the kinds that occur, and the kind of each row.

    Returns:
        Kinds, the most frequent first, shape (parts, kinds); kind of each row, −1 if it is not
        identified.
    """
    sizes = tuple(int(column.max(initial=-1)) + 2 for column in columns)  # −1 is a number too
    kind = np.ravel_multi_index(tuple(column[identified] + 1 for column in columns), sizes)
    distinct, of_row, counts = np.unique(kind, return_inverse=True, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    rank = np.empty(order.size, dtype=np.int32)
    rank[order] = np.arange(order.size)
    group = np.full(identified.size, -1, dtype=np.int32)
    group[identified] = rank[of_row]
    return np.stack(np.unravel_index(distinct[order], sizes)) - 1, group


class _LimitVerdict:
    """Verdict of the limits on every row."""

    def __init__(self, identified: NDArray[np.bool_], group: NDArray[np.int32]) -> None:
        self._identified = identified
        self._group = group
        self._conforming = identified.copy()
        self._certain = identified.copy()
        self.limited = np.zeros(identified.size, dtype=bool)

    def judge(self, values: FloatArray, u: FloatArray, limits: Sequence[Limit | None]) -> None:
        """Judge one parameter of all rows by the limit of each row's group."""
        for number, limit in enumerate(limits):
            if limit is not None:
                in_group = self._group == number
                inside = limit.inside(values[in_group])
                self.limited |= in_group
                self._conforming[in_group] &= inside
                self._certain[in_group] &= inside & limit.certain(values[in_group], u[in_group])

    def of_all(self, sound: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return the rows that conform, and those that conform for all values within U.

        Without limits they are the sound rows.
        """
        plain = self._identified & sound
        return np.where(self.limited, self._conforming, plain), np.where(
            self.limited, self._certain, plain
        )


def outlier_limit(count: int) -> float:
    """Return the distance from the median above which one of ``count`` values is an outlier.

    It is in robust standard deviations.
    """
    return NormalDist().inv_cdf(1 - FALSE_ALARM / (2 * count)) * (1 + SMALL_COUNT_FACTOR / count)


def _limit(
    specification: Specification, type_: str | None, parameter: str, units: dict[str, str]
) -> Limit | None:
    limit = specification.limit(type_, parameter)
    return (
        limit if limit is None or limit.unit is None or limit.unit == units.get(parameter) else None
    )


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
    low, first, third, high = (
        float(quantile) for quantile in np.quantile(values, [0.0, 0.25, 0.75, 1.0])
    )
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
    every: FloatArray,
    u: FloatArray,
    limit: Limit | None,
) -> list[FleetOutlier]:
    """Return the outliers of one group's rows of the table.

    ``every`` and ``u`` are columns of the whole table.
    """
    values = every[rows]
    none = np.zeros(rows.size, dtype=bool)
    median = float(np.median(values))
    spread = SD_PER_MAD * float(np.median(np.abs(values - median)))
    distance = np.abs(values - median) / spread if spread > 0 else np.zeros(rows.size)
    apart = distance > outlier_limit(rows.size) if rows.size >= MIN_OUTLIER_VALUES else none
    outside = none if limit is None else ~limit.inside(values)
    return [
        FleetOutlier(
            row=row,
            parameter=parameter,
            unit=unit,
            value=float(every[row]),
            u=float(u[row]) if np.isfinite(u[row]) else None,
            distance=float(distance[i]),
            outside=bool(outside[i]),
        )
        for i, row in enumerate(rows.tolist())
        if apart[i] or outside[i]
    ]


def _yields(
    types: _Codes,
    identified: NDArray[np.bool_],
    conforming: NDArray[np.bool_],
    certain: NDArray[np.bool_],
) -> list[Yield]:
    numbers, of_type = np.unique(types.numbers, return_inverse=True)
    counts = [
        np.bincount(of_type, weights=rows, minlength=numbers.size)
        for rows in (identified, conforming, certain)
    ]
    total = np.bincount(of_type, minlength=numbers.size)
    yields = [
        Yield(types.name(int(number)), int(total[i]), *(int(rows[i]) for rows in counts))
        for i, number in enumerate(numbers)
    ]
    return sorted(yields, key=lambda rows: -rows.calibrations)


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
        return np.array(
            self._column(name).to_numpy(zero_copy_only=False), dtype=float
        )  # null as NaN

    def sound(self) -> NDArray[np.bool_]:
        """Return the rows whose model is adequate, without a warning."""
        adequate = self._column("adequate").fill_null(False)
        warnings = self._column("warnings")
        count = warnings.value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
        return adequate.to_numpy(zero_copy_only=False) & (count == 0)

    def is_text(self, name: str, text: str) -> NDArray[np.bool_]:
        codes = self.codes(name)
        return np.array([*(own_text == text for own_text in codes.texts), False])[
            codes.numbers
        ]  # −1 takes the last

    def codes(self, name: str) -> _Codes:
        column = self._column(name)
        return _Codes(
            column.indices.fill_null(-1).to_numpy(zero_copy_only=False),
            column.dictionary.to_pylist(),
        )

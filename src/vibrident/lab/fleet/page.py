"""``fleet.html``: one file that shows a fleet: yield, distributions with limits, outliers, doubts, what was refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vibrident.base import memory
from vibrident.base.amounts import scaled
from vibrident.base.files import atomic_write
from vibrident.lab.fleet.limits import Limit, Specification
from vibrident.lab.fleet.row import FAILED, IDENTIFIED, REFUSED
from vibrident.lab.fleet.statistics import Distribution, Group, Histogram, Statistics, statistics
from vibrident.lab.fleet.table import Tally
from vibrident.physics.naming import is_derived, parameter_name
from vibrident.show import axes, words
from vibrident.show.media import html
from vibrident.show.numbers import NONE, pair
from vibrident.show.views import (
    BLACK,
    SKY,
    VERMILION,
    Axis,
    Beside,
    Block,
    Card,
    Cards,
    Column,
    Document,
    Facts,
    Figure,
    Folded,
    Look,
    Panel,
    Sentence,
    Series,
    Stack,
    Table,
    columns,
    document,
    section,
)

MOST_KINDS = 40  # messages shown
MOST_NAMES = 5  # calibrations named beside each message
_MOST_TYPES = 100  # types shown in the table of yields
_ROWS = 4096  # rows in memory at the same time
_JUDGED = ("limits", "outside", "undecided", "Cpk")  # columns of parameters with a limit
_LEGEND = Sentence(
    "Bars: calibrations. Red lines: limits, with what lies outside shaded; dashed: nominal. ◂ and "
    "▸ count what lies beyond the ends. Undecided: values within U (k = 2) of a limit, inside or "
    "outside. Cpk: distance of the mean from the nearer limit over 3 sd."
)


def write_page(
    path: Path, table: Path, tally: Tally, specification: Specification, began_at: float
) -> Path:
    """Write the page, beside the folder of whole results, of a table and its tally; return its path.

    ``specification``: limits by type; ``began_at``: of this run, in seconds since 1970.
    """
    made = content(
        table, tally, specification, began_at, results=(path.parent / "results").is_dir()
    )
    with atomic_write(path) as partial:
        partial.write_bytes(html.printed(made).encode("utf-8", "replace"))
    return path


def content(
    table: Path, tally: Tally, specification: Specification, began_at: float, *, results: bool
) -> Document:
    """The content of the page; ``results``: whole results stand beside it, to be linked."""
    found = statistics(table, tally, specification)
    memory.return_freed()
    named = _Names(table, [one.row for one in found.outliers])
    sections = [
        section("yield", "Yield", *_yields(found)),
        section("distributions", "Distributions", *_distributions(found, specification)),
        section("outliers", "Outliers", *_outliers(found, named, results)),
        section("warnings", "Warnings", _warnings(tally)),
        section("refused", "Refused and failed", *_refused(named)),
        section("throughput", "Throughput", *_throughput(named.seconds, tally, began_at)),
    ]
    return document("Fleet of sensors", (_verdict(tally, found), _cards(tally, found)), sections)


class _Names:
    """The single rows on the page, read in pieces: outliers, and refused or failed calibrations."""

    def __init__(self, table: Path, rows: Sequence[int]) -> None:
        import pyarrow.parquet as pq

        self.of: dict[int, tuple[str, str, str]] = {}  # row → calibration, serial number, key
        self.kinds: Counter[tuple[str, str]] = Counter()  # status and problem
        self.examples: dict[tuple[str, str], tuple[str, list[str]]] = {}  # message, calibrations
        wanted = set(rows)
        start = 0
        seconds = []
        with pq.ParquetFile(table) as file:
            columns = ["calibration", "key", "status", "message", "serial_number", "seconds"]
            for batch in file.iter_batches(_ROWS, columns=columns):
                found = batch.to_pydict()
                for i, status in enumerate(found["status"]):
                    if start + i in wanted:
                        told = (
                            found["calibration"][i],
                            found["serial_number"][i] or "",
                            found["key"][i],
                        )
                        self.of[start + i] = told
                    if status != IDENTIFIED:
                        self._count(status, found["message"][i], found["calibration"][i])
                seconds.append(
                    np.asarray(batch["seconds"].to_numpy(zero_copy_only=False), dtype=float)
                )
                start += batch.num_rows
        self.seconds = np.concatenate(seconds) if seconds else np.zeros(0)

    def _count(self, status: str, message: str, calibration: str) -> None:
        kind = status, message.partition("\n")[0]
        self.kinds[kind] += 1
        _, names = self.examples.setdefault(kind, (message, []))
        if len(names) < MOST_NAMES:
            names.append(calibration)


def _percent(part: int, whole: int) -> str:
    share = 100 * part / whole if whole else 0.0
    return f"{share:.4g} %" if share in (0.0, 100.0) else f"{share:.2f} %"


def _verdict(tally: Tally, found: Statistics) -> Sentence:
    conforming = sum(one.conforming for one in found.yields)
    rule = "keep all limits" if found.limited else "raise no doubt"
    counts = {
        "refused": tally.statuses[REFUSED],
        "failed": tally.statuses[FAILED],
        "identified with a doubt": tally.doubtful,
    }
    rest = (
        ", ".join(f"{count} {what}" for what, count in counts.items() if count)
        or "none refused, failed or doubtful"
    )
    kind = "doubt" if tally.doubts else "fine"
    return Sentence(f"{rest}.", kind, f"{conforming} of {tally.rows} calibrations {rule};")


def _cards(tally: Tally, found: Statistics) -> Cards:
    total = tally.rows
    conforming = sum(one.conforming for one in found.yields)
    counts = {
        "Identified": tally.statuses[IDENTIFIED],
        "With a doubt": tally.doubtful,
        "Refused": tally.statuses[REFUSED],
        "Failed": tally.statuses[FAILED],
    }
    rule = "conform to all limits" if found.limited else "without a doubt"
    cards = [Card(name, str(count), _percent(count, total)) for name, count in counts.items()]
    whole = Card("Calibrations", str(total), "\N{NO-BREAK SPACE}")
    return Cards((whole, cards[0], Card("Yield", _percent(conforming, total), rule), *cards[1:]))


def _yields(found: Statistics) -> tuple[Block, ...]:
    rule = (
        (
            "A calibration conforms where every limited parameter is within its limits; of types "
            "without limits, where no doubt was raised. “Beyond doubt” are those that conform "
            "whatever the value is within U (k = 2)."
        )
        if found.limited
        else "No limits were given, so a calibration counts that was identified without a doubt."
    )
    counts = columns("calibrations", "identified", "conform", "beyond doubt", kind="number")
    rows = tuple(
        (
            one.type or "not stated",
            *map(str, (one.calibrations, one.identified, one.conforming, one.certain)),
            _percent(one.conforming, one.calibrations),
        )
        for one in found.yields[:_MOST_TYPES]
    )
    return Sentence(rule), Table((Column("type"), *counts, Column("yield", "share")), rows)


def _distributions(found: Statistics, specification: Specification) -> Iterator[Block]:
    if found.groups:
        yield _LEGEND
    for group in found.groups:
        yield _numbers(group, specification)
        for derived in (False, True):
            drawn = [
                distribution(one)
                for one in group.distributions
                if is_derived(one.parameter) == derived
            ]
            gallery = Beside(tuple(drawn))
            if drawn:
                yield Folded("Derived parameters", (gallery,)) if derived else gallery
    if found.more:
        yield Sentence(f"{found.more} smaller groups are in fleet.parquet and not drawn.", "note")


def _numbers(group: Group, specification: Specification) -> Table:
    """A row a parameter; below it the limits that were not applied because they are in another unit."""
    title = " · ".join(part for part in (group.type or "type not stated", group.model) if part)
    said = []
    for one in group.distributions:
        limit = specification.limit(group.type, one.parameter)
        if limit is not None and one.limit is None:
            name = parameter_name(one.parameter).words
            said.append(
                f"The limit of the {name} is in {limit.unit}, the values are in {one.unit}: not "
                "judged."
            )
    limited = any(one.limit for one in group.distributions)
    heads = ("n", "median", "sd", "least", "greatest", "median u", *(_JUDGED if limited else ()))
    return Table(
        (*columns("parameter", "unit"), *columns(*heads, kind="number")),
        tuple(_row(one)[: 2 + len(heads)] for one in group.distributions),
        notes=tuple(said),
        title=f"{title}: {group.count}",
    )


def _row(one: Distribution) -> tuple[str, ...]:
    scale = scaled(one.unit, max(abs(one.least), abs(one.greatest)))
    limit = one.limit
    judged = (NONE,) * len(_JUDGED)
    if limit is not None:
        span = f"{limit.lower * scale.factor:.5g} … {limit.upper * scale.factor:.5g}"
        capability = NONE if one.capability is None else f"{one.capability:.2f}"
        judged = (span, str(one.count - one.conforming), str(one.count - one.certain), capability)
    return (
        parameter_name(one.parameter).words,
        scale.printed,
        str(one.count),
        f"{one.median * scale.factor:.5g}",
        f"{one.sd * scale.factor:.3g}" if one.count > 1 else NONE,
        *(f"{value * scale.factor:.5g}" for value in (one.least, one.greatest)),
        NONE if one.median_u is None else f"{one.median_u * scale.factor:.2g}",
        *judged,
    )


def _outliers(found: Statistics, named: _Names, results: bool) -> Iterator[Block]:
    yield Sentence(
        "Values outside their limits, and values that stand apart: so far from the median, in "
        "robust standard deviations, that a normal distribution of the group's size shows such a "
        "value in one group and parameter of a hundred."
    )
    if not found.outliers:
        yield Sentence("There are none.")
        return
    rows = []
    links = {}
    for i, one in enumerate(found.outliers):
        calibration, serial_number, key = named.of[one.row]
        scale = scaled(one.unit, one.value)
        rows.append(
            (
                serial_number or calibration,
                parameter_name(one.parameter).words,
                *pair(
                    one.value * scale.factor, None if one.u is None else 2 * one.u * scale.factor
                ),
                scale.printed,
                f"{one.distance:.1f}",
                "outside" if one.outside else "",
                calibration,
            )
        )
        if results:
            links[i] = f"results/{key}.json"
    more = (f"{found.more_outliers} more are not listed.",) if found.more_outliers else ()
    heads = (
        *columns("sensor", "parameter"),
        *columns("value", "U (k = 2)", kind="number"),
        Column("unit"),
    )
    heads += (Column("robust sd from the median", "number"), *columns("limits", "calibration"))
    yield Table(heads, tuple(rows), notes=more, links=links)


def _warnings(tally: Tally) -> Block:
    identified = tally.statuses[IDENTIFIED]
    if not tally.warnings:
        return Sentence(f"None, in {identified} identified calibrations.")
    heads = (
        *columns("code", "says"),
        Column("calibrations", "number"),
        Column("of those identified", "share"),
    )
    rows = tuple(
        (code, words.explain(code).title, str(count), _percent(count, identified))
        for code, count in tally.warnings.most_common()
    )
    return Table(heads, rows)


def _refused(named: _Names) -> Iterator[Block]:
    if not named.kinds:
        yield Sentence("None.")
    heads = (Column("calibrations", "number"), *columns("why", "which"))
    listed = named.kinds.most_common(MOST_KINDS)
    for status in (REFUSED, FAILED):
        rows = []
        messages = []
        for kind, count in (one for one in listed if one[0][0] == status):
            message, names = named.examples[kind]
            more = f" and {count - len(names)} more" if count > len(names) else ""
            rows.append((str(count), kind[1], ", ".join(names) + more))
            messages.append((kind[1], "; ".join(line.strip() for line in message.splitlines()[1:])))
        if rows:
            number = sum(count for kind, count in named.kinds.items() if kind[0] == status)
            yield Table(heads, tuple(rows), title=f"{status.capitalize()}: {number}")
            yield Folded("The first message of each", (Facts(tuple(messages)),))
    if len(named.kinds) > MOST_KINDS:
        yield Sentence(f"{len(named.kinds) - MOST_KINDS} more kinds are in fleet.parquet.", "note")


def _throughput(seconds: np.ndarray, tally: Tally, began_at: float) -> Iterator[Block]:
    yield Sentence(
        f"{tally.rows} calibrations took {seconds.sum():.4g} s of work, {np.mean(seconds):.3g} s "
        "each in the mean."
    )
    now = tally.finished[tally.finished >= began_at] - began_at
    drawn = []
    if now.size:
        elapsed = max(float(now.max()), 1e-9)
        yield Sentence(
            f"This run computed {now.size} in {elapsed:.4g} s, {now.size / elapsed:.3g} a second."
        )
        drawn.append(over_time(now, "calibrations done"))
    else:
        yield Sentence("This run computed none: all were there.")
    positive = seconds[seconds > 0]
    if positive.size:
        top = float(np.quantile(positive, 0.995)) or 1.0
        counts, edges = np.histogram(positive, 30, (0.0, top))
        found = Histogram(edges, counts, 0, int((positive > top).sum()))
        drawn.append(histogram(found, "seconds of a calibration"))
    yield Beside(tuple(drawn))


_BARS = Look(SKY)
_OUTSIDE = Look("#fbeee6", width=0.0)
_ROOM = 0.03  # beside the bars, as a part of their range: half of a tick's label
_LIMIT = Look(VERMILION, width=1.6)
_NOMINAL = Look(BLACK, "dashed", 1.4)


def distribution(found: Distribution) -> Figure:
    """A histogram of a parameter, with its limits and its nominal value."""
    scale = scaled(found.unit, max(abs(found.least), abs(found.greatest)))
    name = parameter_name(found.parameter).words
    label = f"{name} in {scale.printed}" if scale.printed else name
    return histogram(found.histogram, label, scale.factor, found.limit)


def over_time(seconds: NDArray[np.float64], label: str) -> Figure:
    """Calibrations finished in each interval of time; shape (calibrations,), seconds since the beginning."""
    longest = float(seconds.max(initial=0.0))
    unit, factor = (
        ("h", 1 / 3600) if longest > 10_000 else ("min", 1 / 60) if longest > 300 else ("s", 1.0)
    )
    counts, edges = np.histogram(seconds, 30, (0.0, max(longest, 1e-3)))
    return histogram(
        Histogram(edges, counts, 0, 0), f"{label}, in {unit} since the beginning", factor
    )


def histogram(
    found: Histogram, label: str, factor: float = 1.0, limit: Limit | None = None
) -> Figure:
    """Bars over an axis.

    ``found``: counts; ``label``: under the axis; ``factor``: from the values to the numbers on the
    axis; ``limit``: for the values.
    """
    edges = found.edges * factor
    tallest = float(max(found.counts.max(), 1))
    low = float(edges[0])
    high = float(edges[-1])
    bars = Series(
        (edges[1:] + edges[:-1]) / 2,
        found.counts.astype(float),
        "",
        _BARS,
        "columns",
        np.diff(edges) / 2,
    )
    series = [bars] if limit is None else [*_outside(limit, factor, low, high, tallest), bars]
    if limit is not None:
        for value, look in (
            (limit.nominal, _NOMINAL),
            (limit.lower, _LIMIT),
            (limit.upper, _LIMIT),
        ):
            if low <= value * factor <= high:
                series.append(
                    Series(np.full(2, value * factor), np.array([0.0, tallest]), "", look)
                )
    room = _ROOM * (high - low)
    x = Axis(label, low - room, high + room, axes.linear_ticks(low, high, 4))
    y = Axis("", 0.0, tallest, axes.linear_ticks(0.0, tallest, 4, whole_numbers=True))
    beyond = (f"◂ {found.below}" if found.below else "", f"{found.above} ▸" if found.above else "")
    panel = Panel(x, y, tuple(series), 1.2, " · ".join(filter(None, beyond)))
    return Figure("histogram", label, (Stack((panel,)),), width_in=3.4)


def _outside(limit: Limit, factor: float, low: float, high: float, top: float) -> list[Series]:
    """Shade the values that do not conform."""
    stretches = ((low, min(limit.lower * factor, high)), (max(limit.upper * factor, low), high))
    return [
        Series(
            np.array([(stop + start) / 2]),
            np.array([top]),
            "",
            _OUTSIDE,
            "columns",
            np.array([(stop - start) / 2]),
        )
        for start, stop in stretches
        if stop > start
    ]

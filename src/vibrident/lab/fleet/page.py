"""Page of a fleet, ``fleet.html``: yield, distributions with limits, outliers, doubts, refusals."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from vibrident.base import memory
from vibrident.base.amounts import scaled
from vibrident.base.files import atomic_write
from vibrident.lab.fleet.figures import distribution, histogram, over_time
from vibrident.lab.fleet.limits import Specification
from vibrident.lab.fleet.row import FAILED, IDENTIFIED, REFUSED
from vibrident.lab.fleet.statistics import (
    Distribution,
    FleetGroup,
    Histogram,
    Statistics,
    statistics,
)
from vibrident.lab.fleet.table import Tally
from vibrident.physics.naming import is_derived, parameter_name
from vibrident.show import words
from vibrident.show.media import html
from vibrident.show.numbers import NONE, pair
from vibrident.show.views import (
    Block,
    Card,
    Cards,
    Column,
    Document,
    Facts,
    Folded,
    Gallery,
    Sentence,
    Table,
    columns,
    document,
    section,
)

MAX_MESSAGES = 40  # on the page
MAX_EXAMPLES = 5  # calibrations named with each message
_MAX_TYPES = 100  # in the table of yields
_BATCH_ROWS = 4096  # in memory at the same time
_LIMIT_COLUMNS = ("limits", "outside", "undecided", "Cpk")  # columns of parameters with a limit
_LEGEND = Sentence(
    "Bars: calibrations. Red lines: limits, with what lies outside shaded; dashed: nominal. ◂ and "
    "▸ count what lies beyond the ends. Undecided: values within U (k = 2) of a limit, inside or "
    "outside. Cpk: distance of the mean from the nearer limit over 3 sd."
)


def write_page(
    path: Path, table: Path, tally: Tally, specification: Specification, began_at: float
) -> Path:
    """Write the page of a table and its tally; return its path.

    Args:
        path: of the page, in the folder of the folder of whole results.
        table: of the fleet.
        tally: of the table.
        specification: limits by type.
        began_at: start of this run, in seconds since 1970.
    """
    page = content(
        table, tally, specification, began_at, results=(path.parent / "results").is_dir()
    )
    with atomic_write(path) as partial:
        partial.write_bytes(html.printed(page).encode("utf-8", "replace"))
    return path


def content(
    table: Path, tally: Tally, specification: Specification, began_at: float, *, results: bool
) -> Document:
    """Return the content of the page; ``results``: there are whole results to link."""
    fleet = statistics(table, tally, specification)
    memory.return_freed()
    listed = _ListedRows(table, [outlier.row for outlier in fleet.outliers])
    sections = [
        section("yield", "Yield", *_yields(fleet)),
        section("distributions", "Distributions", *_distributions(fleet, specification)),
        section("outliers", "Outliers", *_outliers(fleet, listed, results)),
        section("warnings", "Warnings", _warnings(tally)),
        section("refused", "Refused and failed", *_refused(listed)),
        section("throughput", "Throughput", *_throughput(listed.seconds, tally, began_at)),
    ]
    return document("Fleet of sensors", (_verdict(tally, fleet), _cards(tally, fleet)), sections)


class _ListedRows:
    """Single rows on the page: outliers, and refused or failed calibrations.

    Attributes:
        outliers: row → calibration, serial number and key.
        kinds: number of refused or failed calibrations by status and problem.
        examples: message of the first calibration of each kind, and names of some.
        seconds: duration of each calibration, shape (rows,).
    """

    def __init__(self, table: Path, rows: Sequence[int]) -> None:
        import pyarrow.parquet as pq

        self.outliers: dict[int, tuple[str, str, str]] = {}
        self.kinds: Counter[tuple[str, str]] = Counter()
        self.examples: dict[tuple[str, str], tuple[str, list[str]]] = {}
        seconds = [np.zeros(0)]
        numbers = itertools.count()
        listed = frozenset(rows)
        names = ["calibration", "key", "status", "message", "serial_number"]
        with pq.ParquetFile(table) as file:
            for batch in file.iter_batches(_BATCH_ROWS, columns=[*names, "seconds"]):
                seconds.append(np.asarray(batch["seconds"], dtype=float))
                texts = (batch[name].to_pylist() for name in names)
                for calibration, key, status, message, serial_number in zip(*texts, strict=True):
                    number = next(numbers)
                    if number in listed:
                        self.outliers[number] = (calibration, serial_number or "", key)
                    if status != IDENTIFIED:
                        self._count(status, message, calibration)
        self.seconds = np.concatenate(seconds)

    def _count(self, status: str, message: str, calibration: str) -> None:
        kind = status, message.partition("\n")[0]
        self.kinds[kind] += 1
        _, names = self.examples.setdefault(kind, (message, []))
        if len(names) < MAX_EXAMPLES:
            names.append(calibration)


def _percent(count: int, total: int) -> str:
    share = 100 * count / total if total else 0.0
    return f"{share:.4g} %" if share in (0.0, 100.0) else f"{share:.2f} %"


def _verdict(tally: Tally, fleet: Statistics) -> Sentence:
    conforming = sum(row.conforming for row in fleet.yields)
    rule = "keep all limits" if fleet.limited else "raise no doubt"
    counts = {
        "refused": tally.statuses[REFUSED],
        "failed": tally.statuses[FAILED],
        "identified with a doubt": tally.doubtful,
    }
    doubts = ", ".join(f"{count} {outcome}" for outcome, count in counts.items() if count)
    doubts = doubts or "none refused, failed or doubtful"
    kind = "doubt" if tally.doubts else "fine"
    return Sentence(f"{doubts}.", kind, f"{conforming} of {tally.rows} calibrations {rule};")


def _cards(tally: Tally, fleet: Statistics) -> Cards:
    total = tally.rows
    conforming = sum(row.conforming for row in fleet.yields)
    counts = {
        "Identified": tally.statuses[IDENTIFIED],
        "With a doubt": tally.doubtful,
        "Refused": tally.statuses[REFUSED],
        "Failed": tally.statuses[FAILED],
    }
    rule = "conform to all limits" if fleet.limited else "without a doubt"
    cards = [Card(name, str(count), _percent(count, total)) for name, count in counts.items()]
    total_card = Card("Calibrations", str(total), "\N{NO-BREAK SPACE}")
    return Cards(
        (total_card, cards[0], Card("Yield", _percent(conforming, total), rule), *cards[1:])
    )


def _yields(fleet: Statistics) -> tuple[Block, ...]:
    rule = (
        (
            "A calibration conforms where every limited parameter is within its limits; of types "
            "without limits, where no doubt was raised. “Beyond doubt” are those that conform "
            "whatever the value is within U (k = 2)."
        )
        if fleet.limited
        else "No limits were given, so a calibration counts that was identified without a doubt."
    )
    counts = columns("calibrations", "identified", "conform", "beyond doubt", kind="number")
    rows = tuple(
        (
            row.type or "not stated",
            *map(str, (row.calibrations, row.identified, row.conforming, row.certain)),
            _percent(row.conforming, row.calibrations),
        )
        for row in fleet.yields[:_MAX_TYPES]
    )
    return Sentence(rule), Table((Column("type"), *counts, Column("yield", "share")), rows)


def _distributions(fleet: Statistics, specification: Specification) -> Iterator[Block]:
    if fleet.groups:
        yield _LEGEND
    for group in fleet.groups:
        yield _numbers(group, specification)
        for derived in (False, True):
            drawn = [
                distribution(entry)
                for entry in group.distributions
                if is_derived(entry.parameter) == derived
            ]
            gallery = Gallery(tuple(drawn))
            if drawn:
                yield Folded("Derived parameters", (gallery,)) if derived else gallery
    if fleet.hidden_groups:
        text = f"{fleet.hidden_groups} smaller groups are in fleet.parquet and not drawn."
        yield Sentence(text, "note")


def _numbers(group: FleetGroup, specification: Specification) -> Table:
    """Return a table with a row a parameter, and the limits that do not apply as notes.

    A limit in a unit that measures something else does not apply.
    """
    title = " · ".join(word for word in (group.type or "type not stated", group.model) if word)
    notes = []
    for entry in group.distributions:
        limit = specification.limit(group.type, entry.parameter)
        if limit is not None and entry.limit is None:
            name = parameter_name(entry.parameter).words
            notes.append(
                f"The limit of the {name} is in {limit.unit}, the values are in {entry.unit}: "
                "none of them conforms."
            )
    limited = any(entry.limit for entry in group.distributions)
    heads = (
        "n",
        "median",
        "sd",
        "least",
        "greatest",
        "median u",
        *(_LIMIT_COLUMNS if limited else ()),
    )
    return Table(
        (*columns("parameter", "unit"), *columns(*heads, kind="number")),
        tuple(_row(entry)[: 2 + len(heads)] for entry in group.distributions),
        notes=tuple(notes),
        title=f"{title}: {group.count}",
    )


def _row(entry: Distribution) -> tuple[str, ...]:
    scale = scaled(entry.unit, max(abs(entry.least), abs(entry.greatest)))
    limit = entry.limit
    verdict = (NONE,) * len(_LIMIT_COLUMNS)
    if limit is not None:
        span = f"{limit.lower * scale.factor:.5g} … {limit.upper * scale.factor:.5g}"
        capability = NONE if entry.capability is None else f"{entry.capability:.2f}"
        verdict = (
            span,
            str(entry.count - entry.conforming),
            str(entry.count - entry.certain),
            capability,
        )
    return (
        parameter_name(entry.parameter).words,
        scale.printed,
        str(entry.count),
        f"{entry.median * scale.factor:.5g}",
        f"{entry.sd * scale.factor:.3g}" if entry.count > 1 else NONE,
        *(f"{value * scale.factor:.5g}" for value in (entry.least, entry.greatest)),
        NONE if entry.median_u is None else f"{entry.median_u * scale.factor:.2g}",
        *verdict,
    )


def _outliers(fleet: Statistics, listed: _ListedRows, results: bool) -> Iterator[Block]:
    yield Sentence(
        "Values outside their limits, and values that stand apart: so far from the median, in "
        "robust standard deviations, that a normal distribution of the group's size shows such a "
        "value in one group and parameter of a hundred."
    )
    if not fleet.outliers:
        yield Sentence("There are none.")
        return
    rows = []
    links = {}
    for i, outlier in enumerate(fleet.outliers):
        calibration, serial_number, key = listed.outliers[outlier.row]
        scale = scaled(outlier.unit, outlier.value)
        rows.append(
            (
                serial_number or calibration,
                parameter_name(outlier.parameter).words,
                *pair(
                    outlier.value * scale.factor,
                    None if outlier.u is None else 2 * outlier.u * scale.factor,
                ),
                scale.printed,
                f"{outlier.distance:.1f}",
                "outside" if outlier.outside else "",
                calibration,
            )
        )
        if results:
            links[i] = f"results/{key}.json"
    more = (f"{fleet.hidden_outliers} more are not listed.",) if fleet.hidden_outliers else ()
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


def _refused(listed: _ListedRows) -> Iterator[Block]:
    if not listed.kinds:
        yield Sentence("None.")
    heads = (Column("calibrations", "number"), *columns("why", "which"))
    most_common = listed.kinds.most_common(MAX_MESSAGES)
    for status in (REFUSED, FAILED):
        rows = []
        messages = []
        for kind, count in (entry for entry in most_common if entry[0][0] == status):
            message, names = listed.examples[kind]
            more = f" and {count - len(names)} more" if count > len(names) else ""
            rows.append((str(count), kind[1], ", ".join(names) + more))
            messages.append((kind[1], "; ".join(line.strip() for line in message.splitlines()[1:])))
        if rows:
            number = sum(count for kind, count in listed.kinds.items() if kind[0] == status)
            yield Table(heads, tuple(rows), title=f"{status.capitalize()}: {number}")
            yield Folded("The first message of each", (Facts(tuple(messages)),))
    if len(listed.kinds) > MAX_MESSAGES:
        yield Sentence(
            f"{len(listed.kinds) - MAX_MESSAGES} more kinds are in fleet.parquet.", "note"
        )


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
        durations = Histogram(edges, counts, 0, int((positive > top).sum()))
        drawn.append(histogram(durations, "seconds of a calibration"))
    yield Gallery(tuple(drawn))

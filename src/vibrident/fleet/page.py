"""``fleet.html``: one file that shows a fleet: yield, distributions with limits, outliers, doubts, what was refused."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vibrident.fleet import drawing
from vibrident.fleet.limits import Limit, Specification
from vibrident.fleet.parts import write_whole
from vibrident.fleet.row import FAILED, IDENTIFIED, REFUSED
from vibrident.fleet.statistics import Distribution, Group, Outlier, Statistics, Yield, statistics
from vibrident.fleet.table import Tally
from vibrident.naming import is_derived, parameter_name, scaled
from vibrident.present import words
from vibrident.present.page import Page, folded, paragraphs, text
from vibrident.present.views import BLUE, GREEN, VERMILION

#: Number of messages shown, and of calibrations named beside each.
MOST_KINDS, MOST_NAMES = 40, 5
#: Rows in memory at the same time.
_ROWS = 4096
_STYLE = """<style>
.charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(245px, 1fr)); gap: 10px 22px; }
.charts figure { margin: 0.3rem 0; } .charts svg { width: 100%; height: auto; display: block; }
header .cards { grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); }
pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: 0.85rem; }
td code { overflow-wrap: anywhere; } #yield td:first-child { white-space: nowrap; }
</style>"""
_LEGEND = (
    "Bars: calibrations. Red lines: limits, with what lies outside shaded; dashed: nominal. ◂ and ▸ count what lies "
    "beyond the ends. Undecided: values within U (k = 2) of a limit, inside or outside. Cpk: distance of the mean from "
    "the nearer limit over 3 sd."
)


def write_page(path: Path, table: Path, tally: Tally, specification: Specification, began_at: float) -> Path:
    """Write the page of a fleet's table; return its path.

    Args:
        path: of the page, beside the table and the folder of whole results.
        table: ``fleet.parquet``.
        tally: of the table.
        specification: limits by type.
        began_at: beginning of this run, in seconds since 1970.
    """
    found = statistics(table, tally, specification)
    named = _Names(table, [one.row for one in found.outliers])
    page = Page("Fleet of sensors")
    page.head = _STYLE + _verdict(tally, found) + _cards(tally, found)
    page.add("yield", "Yield", _yields(found))
    page.add("distributions", "Distributions", *_distributions(found, specification))
    page.add("outliers", "Outliers", _outliers(found, named, (path.parent / "results").is_dir()))
    page.add("warnings", "Warnings", _warnings(tally))
    page.add("refused", "Refused and failed", _refused(named))
    page.add("throughput", "Throughput", _throughput(named.seconds, tally, began_at))
    write_whole(path, page.html().encode("utf-8", "replace"))
    return path


class _Names:
    """The single rows on the page, read in pieces: outliers, and refused or failed calibrations."""

    def __init__(self, table: Path, rows: Sequence[int]) -> None:
        import pyarrow.parquet as pq

        self.of: dict[int, tuple[str, str, str]] = {}  # row → calibration, serial number, key
        self.kinds: Counter[tuple[str, str]] = Counter()  # status and problem
        self.examples: dict[tuple[str, str], tuple[str, list[str]]] = {}  # message, calibrations
        wanted, start, seconds = set(rows), 0, []
        with pq.ParquetFile(table) as file:
            columns = ["calibration", "key", "status", "message", "serial_number", "seconds"]
            for batch in file.iter_batches(_ROWS, columns=columns):
                self._add(batch.to_pydict(), start, wanted)
                seconds.append(np.asarray(batch["seconds"].to_numpy(zero_copy_only=False), dtype=float))
                start += batch.num_rows
        self.seconds = np.concatenate(seconds) if seconds else np.zeros(0)

    def _add(self, rows: dict[str, list[str]], start: int, wanted: set[int]) -> None:
        for number, status in enumerate(rows["status"], start=start):
            i = number - start
            if number in wanted:
                self.of[number] = rows["calibration"][i], rows["serial_number"][i] or "", rows["key"][i]
            if status != IDENTIFIED:
                message = rows["message"][i]
                kind = status, message.partition("\n")[0]
                self.kinds[kind] += 1
                _, names = self.examples.setdefault(kind, (message, []))
                if len(names) < MOST_NAMES:
                    names.append(rows["calibration"][i])


def _percent(part: int, whole: int) -> str:
    share = 100 * part / whole if whole else 0.0
    return f"{share:.4g} %" if share in (0.0, 100.0) else f"{share:.2f} %"


def _verdict(tally: Tally, found: Statistics) -> str:
    clean = tally.doubts == 0
    conforming = sum(one.conforming for one in found.yields)
    rule = "keep all limits" if found.limited else "raise no doubt"
    said = f"<b>{conforming} of {tally.rows} calibrations {rule}</b>"
    parts = [
        f"{tally.statuses[REFUSED]} refused" if tally.statuses[REFUSED] else "",
        f"{tally.statuses[FAILED]} failed" if tally.statuses[FAILED] else "",
        f"{tally.doubtful} identified with a doubt" if tally.doubtful else "",
    ]
    rest = ", ".join(part for part in parts if part) or "none refused, failed or doubtful"
    return f'<p class="verdict{"" if clean else " doubt"}">{said}; {rest}.</p>'


def _cards(tally: Tally, found: Statistics) -> str:
    total, conforming = tally.rows, sum(one.conforming for one in found.yields)
    identified = tally.statuses[IDENTIFIED]
    cards = [
        ("Calibrations", str(total), ""),
        ("Identified", str(identified), _percent(identified, total)),
        ("Yield", _percent(conforming, total), "conform to all limits" if found.limited else "without a doubt"),
        ("With a doubt", str(tally.doubtful), _percent(tally.doubtful, total)),
        ("Refused", str(tally.statuses[REFUSED]), _percent(tally.statuses[REFUSED], total)),
        ("Failed", str(tally.statuses[FAILED]), _percent(tally.statuses[FAILED], total)),
    ]
    made = (
        f'<div class="card"><span>{text(label)}</span><b>{text(value)}</b><span>{text(below) or "&nbsp;"}</span></div>'
        for label, value, below in cards
    )
    return f'<div class="cards">{"".join(made)}</div>'


def _rows(header: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table of cells that are HTML already."""
    head = "".join(f"<th{' class=n' if j in numbers else ''}>{text(one)}</th>" for j, one in enumerate(header))
    body = "".join(
        "<tr>" + "".join(f"<td{' class=n' if j in numbers else ''}>{one}</td>" for j, one in enumerate(row)) + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _yields(found: Statistics) -> str:
    def row(one: Yield) -> list[str]:
        share = one.conforming / one.calibrations
        return [
            text(one.type or "not stated"),
            str(one.calibrations),
            str(one.identified),
            str(one.conforming),
            str(one.certain),
            _percent(one.conforming, one.calibrations),
            drawing.share_bar(share, GREEN if share >= 0.95 else BLUE),
        ]

    rule = (
        "A calibration conforms where every limited parameter is within its limits; of types without limits, where no "
        "doubt was raised. “Beyond doubt” are those that conform whatever the value is within U (k = 2)."
        if found.limited
        else "No limits were given (--limits), so a calibration counts that was identified without a doubt."
    )
    header = ("type", "calibrations", "identified", "conform", "beyond doubt", "yield", "")
    shown = [row(one) for one in found.yields[:100]]
    return paragraphs([rule]) + _rows(header, shown, (1, 2, 3, 4, 5))


def _distributions(found: Statistics, specification: Specification) -> list[str]:
    parts = [paragraphs([_LEGEND])] if found.groups else []
    for group in found.groups:
        title = " · ".join(part for part in (group.type or "type not stated", group.model) if part)
        parts.append(f"<h3>{text(title)}: {group.count}</h3>")
        parts.append(_charts([one for one in group.distributions if not is_derived(one.parameter)]))
        derived = _charts([one for one in group.distributions if is_derived(one.parameter)])
        parts.append(folded("Derived parameters", derived))
        parts.append(_numbers(group))
        parts += _other_units(group, specification)
    if found.more:
        parts.append(paragraphs([f"{found.more} smaller groups are in fleet.parquet and not drawn."], "note"))
    return parts


def _other_units(group: Group, specification: Specification) -> list[str]:
    """The limits that were not applied because they are in another unit."""
    said = []
    for one in group.distributions:
        limit = specification.limit(group.type, one.parameter)
        if limit is not None and one.limit is None:
            name = parameter_name(one.parameter).words
            said.append(f"The limit of the {name} is in {limit.unit}, the values are in {one.unit}: not judged.")
    return [paragraphs(said, "note")] if said else []


def _charts(found: Sequence[Distribution]) -> str:
    if not found:
        return ""
    figures = "".join(f"<figure>{drawing.distribution(one)}</figure>" for one in found)
    return f'<div class="charts">{figures}</div>'


def _numbers(group: Group) -> str:
    def row(one: Distribution) -> list[str]:
        scale = scaled(one.unit, max(abs(one.least), abs(one.greatest)))
        values = (one.median, one.mean, one.sd, one.least, one.greatest)
        shown = [f"{value * scale.factor:.5g}" for value in values]
        u = "–" if one.median_u is None else f"{one.median_u * scale.factor:.2g}"
        limits = "–" if one.limit is None else _limits(one.limit, scale.factor)
        judged = one.limit is not None
        return [
            text(parameter_name(one.parameter).words),
            text("" if scale.unit == "1" else scale.unit),
            str(one.count),
            *shown,
            u,
            limits,
            str(one.count - one.conforming) if judged else "–",
            str(one.count - one.certain) if judged else "–",
            "–" if one.capability is None else f"{one.capability:.2f}",
        ]

    header = ("parameter", "unit", "n", "median", "mean", "sd", "least", "greatest", "median u", "limits")
    header += ("outside", "undecided", "Cpk")
    return _rows(header, [row(one) for one in group.distributions], (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12))


def _limits(limit: Limit, factor: float) -> str:
    return f"{limit.lower * factor:.5g} … {limit.upper * factor:.5g}"


def _outliers(found: Statistics, named: _Names, results: bool) -> str:
    rule = (
        "Values outside their limits, and values that stand apart: so far from the median, in robust standard "
        "deviations, that a normal distribution of the group's size shows such a value in one group and parameter of "
        "a hundred."
    )

    def row(one: Outlier) -> list[str]:
        calibration, serial_number, key = named.of[one.row]
        scale = scaled(one.unit, one.value)
        u = "–" if one.u is None else f"{2 * one.u * scale.factor:.2g}"
        name = text(serial_number or calibration)
        linked = f'<a href="results/{key}.json">{name}</a>' if results else name
        return [
            linked,
            text(parameter_name(one.parameter).words),
            f"{one.value * scale.factor:.6g}",
            u,
            text("" if scale.unit == "1" else scale.unit),
            f"{one.distance:.1f}",
            "outside" if one.outside else "",
            f"<code>{text(calibration)}</code>",
        ]

    if not found.outliers:
        return paragraphs([rule, "There are none."])
    header = ("sensor", "parameter", "value", "U (k = 2)", "unit", "robust sd from the median", "limits", "calibration")
    made = paragraphs([rule]) + _rows(header, [row(one) for one in found.outliers], (2, 3, 5))
    if found.more_outliers:
        made += paragraphs([f"{found.more_outliers} more are not listed."], "note")
    return made


def _warnings(tally: Tally) -> str:
    identified = tally.statuses[IDENTIFIED]
    if not tally.warnings:
        return paragraphs([f"None, in {identified} identified calibrations."])
    rows = [
        [
            f"<code>{text(code)}</code>",
            text(words.explain(code).title),
            str(count),
            _percent(count, identified),
            drawing.share_bar(count / identified, VERMILION),
        ]
        for code, count in tally.warnings.most_common()
    ]
    return _rows(("code", "says", "calibrations", "of those identified", ""), rows, (2, 3))


def _refused(named: _Names) -> str:
    if not named.kinds:
        return paragraphs(["None."])
    shown = defaultdict(list)
    for kind, count in named.kinds.most_common(MOST_KINDS):
        message, names = named.examples[kind]
        listed = ", ".join(text(name) for name in names) + (f" and {count - len(names)} more" * (count > len(names)))
        example = folded("The first one's message", f"<pre>{_preformatted(message)}</pre>")
        shown[kind[0]].append([str(count), text(kind[1]) + example, listed])
    parts = []
    for status in (REFUSED, FAILED):
        if shown[status]:
            number = sum(count for kind, count in named.kinds.items() if kind[0] == status)
            parts.append(f"<h3>{text(status.capitalize())}: {number}</h3>")
            parts.append(_rows(("calibrations", "why", "which"), shown[status], (0,)))
    if len(named.kinds) > MOST_KINDS:
        parts.append(paragraphs([f"{len(named.kinds) - MOST_KINDS} more kinds are in fleet.parquet."], "note"))
    return "\n".join(parts)


def _preformatted(message: str) -> str:
    return "\n".join(text(line) if not line.startswith(" ") else "  " + text(line) for line in message.splitlines())


def _throughput(seconds: np.ndarray, tally: Tally, began_at: float) -> str:
    now = tally.finished[tally.finished >= began_at] - began_at
    charts = []
    said = [f"{tally.rows} calibrations took {seconds.sum():.4g} s of work, {np.mean(seconds):.3g} s each in the mean."]
    if now.size:
        elapsed = max(float(now.max()), 1e-9)
        said.append(f"This run computed {now.size} in {elapsed:.4g} s, {now.size / elapsed:.3g} a second.")
        charts.append(drawing.over_time(now, "calibrations done"))
    else:
        said.append("This run computed none: all were there.")
    positive = seconds[seconds > 0]
    if positive.size:
        top = float(np.quantile(positive, 0.995)) or 1.0
        counts, edges = np.histogram(positive, 30, (0.0, top))
        found = drawing.Histogram(edges, counts, 0, int((positive > top).sum()))
        charts.append(drawing.histogram(found, "seconds of a calibration"))
    figures = "".join(f"<figure>{one}</figure>" for one in charts)
    return paragraphs(said) + f'<div class="charts">{figures}</div>'

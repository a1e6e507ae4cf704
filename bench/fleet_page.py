"""Figures of studies/fleet.md: what was measured, and what a million sensors would need by it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bench.publish import put_between
from vibrident.show.media import markdown

ROOT = Path(__file__).parents[1]
STORED_FIGURES = ROOT / "bench" / "results" / "fleet.json"
PAGE = ROOT / "studies" / "fleet.md"
CORES = (16, 100, 1000)  # cores of the plan
#: How often a data file is read: for its key, by its reader, and for its key once more.
READS_PER_FILE = 3
MILLION = 1_000_000


def keep(name: str, figures: dict[str, Any]) -> None:
    """Keep a part's figures, and write the page where all are there."""
    figures_by_name = (
        json.loads(STORED_FIGURES.read_text(encoding="utf-8")) if STORED_FIGURES.is_file() else {}
    )
    figures_by_name[name] = figures
    STORED_FIGURES.write_text(json.dumps(figures_by_name, indent=1) + "\n", encoding="utf-8")
    if {"speed", "memory", "study"} <= figures_by_name.keys():
        put_between(
            PAGE,
            "fleet",
            "\n".join(["", _measured(figures_by_name), "", _million(figures_by_name), ""]),
        )


def _measured(figures_by_name: dict[str, Any]) -> str:
    speed = figures_by_name["speed"]
    memory = figures_by_name["memory"]
    study = figures_by_name["study"]
    few, many = (memory["rows"][name] for name in sorted(memory["rows"], key=int))
    killed = ", ".join(str(count) for count in study["rows_after_each_kill"])
    rows = [
        (
            f"`study`: {study['calibrations']} calibrations (21 × 2000 samples; "
            f"{study['refused']} broken in ten ways, two that kill their process), the command "
            f"killed three times (rows then there: {killed})",
            f"{study['rows']} rows, {study['names_that_differ']} names; {study['identified']} "
            f"identified, {study['refused']} refused, {study['failed']} failed; computed twice: "
            f"{study['computed_twice']}; exit {study['exit_code']}",
        ),
        (
            "`speed`: time of the processor for one calibration more, over `identify_many`",
            f"{speed['fleet_over_identify_many']:.3f}; with whole results "
            f"{speed['fleet_with_results_over_identify_many']:.3f}",
        ),
        (
            "time in which the workers read and identify, as a share of all",
            f"one worker {100 * speed['busy_share_of_one_worker']:.1f} %, two "
            f"{100 * speed['busy_share_of_two_workers']:.1f} % each",
        ),
        (
            f"`memory`: of the coordinator with {many['rows']} simulated rows over {few['rows']}",
            f"{memory['memory_ratio']:.2f} ({few['most_mb']:.0f} and {many['most_mb']:.0f} MB; "
            f"{memory['bytes_a_row']:.0f} bytes a row)",
        ),
        ("time of the coordinator for a row", f"{many['milliseconds_a_row']:.2f} ms"),
    ]
    return markdown.table(("`python -m bench.fleet …`", ""), rows)


def _million(figures_by_name: dict[str, Any]) -> str:
    speed = figures_by_name["speed"]
    memory = figures_by_name["memory"]
    many = memory["rows"][max(memory["rows"], key=int)]
    cost = speed["seconds_of_a_calibration"] * speed["fleet_with_results_over_identify_many"]
    data = speed["bytes_of_a_calibration"]
    result = speed["bytes_of_a_result"]
    files = speed["files_of_a_calibration"]
    batch = max(1, round(10 / cost))
    each_s = many["milliseconds_a_row"] / 1e3
    rates = {cores: cores / cost for cores in CORES}
    rows = [
        ("hours", [f"{MILLION / rate / 3600:.1f}" for rate in rates.values()]),
        ("sensors a second", [f"{rate:.0f}" for rate in rates.values()]),
        (
            "data read, GB/s",
            [f"{READS_PER_FILE * rate * data / 1e9:.2g}" for rate in rates.values()],
        ),
        ("of it from disks", [f"{rate * data / 1e9:.2g}" for rate in rates.values()]),
        (
            "files opened a second",
            [f"{READS_PER_FILE * rate * files:.0f}" for rate in rates.values()],
        ),
        (
            "calls of the scheduler a second",
            [f"{rate / batch + rate / 100:.2g}" for rate in rates.values()],
        ),
        (
            "coordinator's share of one core",
            [f"{rate * each_s:.0%}" for rate in rates.values()],
        ),
    ]
    numbers = range(1, 1 + len(CORES))
    table = markdown.table(
        ("cores", *map(str, CORES)), [(what, *values) for what, values in rows], numbers
    )
    coordinator = (many["most_mb"] + memory["bytes_a_row"] * (MILLION - many["rows"]) / 1e6) / 1e3
    table_bytes = many["files_bytes"]["fleet.parquet"] / many["rows"] * MILLION
    parts_bytes = many["bytes_a_row_in_parts"] * MILLION
    sizes = (
        f"One calibration (21 × 2000 samples as CSV) takes {cost:.2f} s of one core of the "
        f"machine that this was measured on, and has {data / 1e6:.1f} MB in {files} files. A "
        f"million have {data / 1e6:.1f} TB; they need {MILLION * cost / 3600:.0f} core-hours, "
        f"{result * MILLION / 1e9:.0f} GB for whole results (none with `--no-results`), "
        f"{parts_bytes / 1e9:.2g} GB for {MILLION / batch:.0f} parts, {table_bytes / 1e9:.2g} GB "
        f"for the table, and {coordinator:.1f} GB of memory for the coordinator. The page stays "
        "as it is."
    )
    return f"{sizes}\n\n{table}"

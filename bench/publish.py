"""Output of a run: a table on the terminal, results/latest.json, the tables of studies/bench.md."""

from __future__ import annotations

import datetime
import json
import os
import platform
import subprocess
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bench.figures import Figure, Section
from vibrident.show.media import markdown

ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results"
DOCUMENT = ROOT / "studies" / "bench.md"
SCHEMA = "vibrident.bench/1"
STYLE = {"met": "green", "NOT met": "bold red", "not measured": "yellow", "": ""}


def circumstances() -> dict[str, Any]:
    """Commit, date and machine, in words."""
    return {
        "commit": _commit(),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "machine": _machine(),
    }


def show(sections: Sequence[Section], console: Console) -> None:
    """Print all sections as one table."""
    table = Table(title="vibrident: benchmarks", title_justify="left")
    table.add_column("figure", overflow="fold")
    table.add_column("value", justify="right")
    table.add_column("target", justify="right")
    table.add_column("")
    table.add_column("remark", overflow="fold", style="dim")
    for section in sections:
        table.add_section()
        table.add_row(Text(section.title, style="bold"))
        for figure in section.figures:
            verdict = Text(figure.verdict, style=STYLE[figure.verdict])
            table.add_row(figure.what, figure.shown, figure.target, verdict, figure.note)
    console.print(table)
    for section in sections:
        for remark in section.remarks:
            console.print(f"{section.name}: {remark}", style="dim", highlight=False)
    console.print(tally(sections))


def tally(sections: Sequence[Section]) -> str:
    """Return how many targets were met."""
    verdicts = [
        figure.verdict for section in sections for figure in section.figures if figure.target
    ]
    missed = verdicts.count("NOT met")
    absent = verdicts.count("not measured")
    words = f"{verdicts.count('met')} of {len(verdicts)} targets met, {missed} not met"
    return f"{words}, {absent} not measured" if absent else words


def keep(sections: Sequence[Section], order: Sequence[str], trial: bool) -> Path:
    """Write the sections of this run as JSON; others keep their figures and their own commit.

    Args:
        sections: of this run; each carries its circumstances in ``conditions``.
        order: names of all sections.
        trial: write to another file, and nothing into the documents.
    """
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / ("trial.json" if trial else "latest.json")
    by_name = {} if trial else _earlier(path)
    by_name.update({section.name: section for section in sections})
    ordered = [by_name[name] for name in order if name in by_name]
    data = {"schema": SCHEMA, "sections": [section.to_json() for section in ordered]}
    _write(path, json.dumps(data, indent=1, ensure_ascii=False) + "\n")
    if not trial:
        _publish(ordered)
    return path


def _earlier(path: Path) -> dict[str, Section]:
    if not path.exists():
        return {}
    data = json.loads(path.read_text(encoding="utf-8"))
    return {section["name"]: Section.from_json(section) for section in data["sections"]}


def _publish(sections: Sequence[Section]) -> None:
    blocks = [tally(sections) + ".", *(_markdown(section) for section in sections)]
    put_between(DOCUMENT, "bench", "\n\n".join(blocks))


def put_between(document: Path, name: str, text: str) -> None:
    """Replace the text between ``<!-- NAME:begin -->`` and ``<!-- NAME:end -->`` of a document."""
    begin = f"<!-- {name}:begin -->"
    end = f"<!-- {name}:end -->"
    before, _, following = document.read_text(encoding="utf-8").partition(begin)
    _, mark, after = following.partition(end)
    if not mark:
        raise ValueError(
            f"{document}: expected the markers {begin} and {end}, found no pair; put them back."
        )
    _write(document, f"{before}{begin}\n{text}\n{end}{after}")


def _markdown(section: Section) -> str:
    conditions = section.conditions
    lines = [
        f"### {section.title}",
        "",
        f"Commit {conditions['commit']}, {conditions['date']}, {conditions['machine']}.",
        "",
        markdown.table(
            ("figure", "value", "target", "", "remark"), map(_row, section.figures), right=(1, 2)
        ),
        "",
        *(f"{remark}\n" for remark in section.remarks),
    ]
    return "\n".join(lines).rstrip()


def _row(figure: Figure) -> tuple[str, ...]:
    verdict = f"**{figure.verdict}**" if figure.verdict == "NOT met" else figure.verdict
    return figure.what, figure.shown, figure.target, verdict, figure.note


def _write(path: Path, text: str) -> None:
    partial = path.with_name(f".{path.name}.part")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)


def _commit() -> str:
    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        sources = ("src", "bench", ":!bench/results", "pyproject.toml")
        changed = git("status", "--porcelain", "--untracked-files=no", "--", *sources)
        return git("rev-parse", "--short", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _machine() -> str:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    software = f"Python {platform.python_version()}, JAX {version('jax')}, numpy {version('numpy')}"
    return f"{_processor()}, {cores} cores, {memory:.0f} GiB; {software}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()

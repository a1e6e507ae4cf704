"""Groups of cases by themselves, printed as they run; figures are kept by the code's state."""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

from bench.adversary.cases import CASES, GROUPS, Case
from bench.adversary.judge import BAD, SILENT, judged, quiet
from vibrident.show.media import markdown

RESULTS = Path(__file__).resolve().parents[1] / "results"
MAX_U_RATIO = 3.0  # ratio of u to that of the same recordings without what is wrong
PAGE = RESULTS.parents[1] / "studies" / "adversary.md"
MAX_CASE_CPU_S = 120.0  # a case that needs more is given up and counts as a traceback
SECTION = "## Drawn groups: "
INTRODUCTION = """Written by `python -m bench.adversary --groups NAME … --first RUN
--keep {state}`. The number of the run draws what a case's name does not say: where the sensor lies
(below the whole band, in it, at its end, above, far above), damping, level and colour of the noise,
shape of the motion, number and length of the records.

- Clean: `quantities`, every quantity of the reference, linear model and motion, `running` where it
  runs when the record begins; `noises`, 1e-5 to 3 % noise of the reference, white, pink, AR(2),
  brown in both channels; `long`, 2e5 to 2e6 samples. `drift` is no false alarm where the noise is
  brown.
- The sensor's parameters are the truth: `clocks`, the response is sampled by a clock that is off by
  1e-6 to 4e-2; `held`, a step, telegraph signals and the stairs of a converter, exact from the
  poles; `joined`, such signals and white noise joined by lines, as `lsim` does; `wild`, bursts of 2
  to 40 wild samples and single glitches; `friction`, dry friction in the sensor.
- Nothing that is stated is true: `unlike`, models that explain little; `steady`, steady tones and
  noise declared decays.

`named`: a warning names the cause (`clocks`: `clock_suspect`; `friction`: `nonlinear`).
`runaway`: a parameter is wrong and more than 30 % off, warned of or not. `wide`, of `wild` alone: a
standard uncertainty is more than three times that of the same recordings without the wild samples,
and the case is in the list. A case is given up
after the CPU seconds in `limit` and counts as a traceback then.
"""
LIST_INTRODUCTION = (
    "Failures and runaways. `python -m bench.adversary --show NAME --run RUN` runs one again.\n"
)


def main(arguments: list[str]) -> int:
    """Run the groups that are asked for and print what failed and the sums."""
    conditions = _parser().parse_args(arguments)
    quiet()
    lines = []
    for name in conditions.groups:
        for case, run in _wanted(name, conditions):
            line = {"name": case.name, "run": run, "limit": conditions.limit}
            line |= _limited(case, run, conditions.limit)
            lines.append(line)
            if conditions.verbose or is_failure(line):
                _print(describe_failure(line))
    _print("")
    for row in sums(lines):
        _print("  ".join(f"{cell:>12}" for cell in row))
    if conditions.keep:
        keep(conditions.keep, conditions.first, lines)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench.adversary", description=__doc__)
    parser.add_argument("--groups", nargs="+", choices=GROUPS, required=True)
    parser.add_argument("--runs", type=int, default=1, help="seeded runs a case")
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    parser.add_argument("--cases", type=int, default=0, help="so many of each group; 0: all")
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose name holds this")
    parser.add_argument("--limit", type=float, default=MAX_CASE_CPU_S, help="CPU seconds a case")
    parser.add_argument(
        "--verbose", action="store_true", help="print all cases, not failures alone"
    )
    parser.add_argument("--keep", default="", metavar="STATE", help="keep the figures for the page")
    return parser


def _wanted(group: str, conditions: argparse.Namespace) -> Iterator[tuple[Case, int]]:
    """Yield cases in their order by chance, and numbers of runs."""
    chosen = [c for c in CASES if c.name.split("/")[0] == group and conditions.only in c.name]
    for case in chosen[: conditions.cases or None]:
        for run in range(conditions.first, conditions.first + conditions.runs):
            yield case, run


def _limited(case: Case, run: int, limit_s: float) -> dict[str, Any]:
    """Judge a case, which is given up after so many CPU seconds."""

    def give_up(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"more than {limit_s:g} CPU s")

    before = signal.signal(signal.SIGPROF, give_up)
    trial = case.trial(run)
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    try:
        return judged(trial)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def is_failure(line: dict[str, Any]) -> bool:
    """Return whether a case belongs on the list: a bad class, a runaway, or u far too large."""
    wide = (line.get("u_ratio") or 0.0) > MAX_U_RATIO
    return line["class"] in BAD or bool(line.get("runaway")) or wide


def describe_failure(line: dict[str, Any]) -> str:
    """Return one line: class, case, what is furthest off, what was said, what chance had set."""
    z = line.get("z") or {"-": 0.0}
    name = max(z, key=lambda key: z[key])
    away = f" runaway {','.join(line['runaway'])}" if line.get("runaway") else ""
    remark = ",".join(line["codes"])
    if remark in ("", "refused"):
        remark = line["says"][0][:90] if line["says"] else "nothing"
    wide = f"u x {line['u_ratio']:.3g}; " if line.get("u_ratio") else ""
    off = "" if name == "-" or z[name] >= 1e300 else f"{name} {z[name]:.3g} u; "
    return (
        f"{line['class']}{away} `{line['name']}` --run {line['run']}: {off}{wide}said {remark};"
        f" {line['cpu']} s; {line.get('drawn', '')}"
    )


def sums(lines: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return a header and a row a group: cases, classes, runaways, silence, CPU seconds."""
    head = ("group", "cases", "right", "warned", "refused", "silent-wrong", "false alarm")
    rows: list[tuple[str, ...]] = [
        (*head, "traceback", "named", "runaway", "wide", "CPU s", "longest", "limit")
    ]
    for group in dict.fromkeys(line["name"].split("/")[0] for line in lines):
        group_lines = [line for line in lines if line["name"].split("/")[0] == group]
        counts = Counter(line["class"] for line in group_lines)
        rows.append(
            (
                group,
                str(len(group_lines)),
                *(str(counts[kind] or "") for kind in (*head[2:], "traceback")),
                str(sum(bool(line.get("named")) for line in group_lines) or ""),
                str(sum(bool(line.get("runaway")) for line in group_lines) or ""),
                str(sum((line.get("u_ratio") or 0.0) > MAX_U_RATIO for line in group_lines) or ""),
                f"{sum(line['cpu'] for line in group_lines):.0f}",
                f"{max(line['cpu'] for line in group_lines):.1f}",
                f"{max(line.get('limit', 0.0) for line in group_lines):.0f}",
            )
        )
    return rows


def keep(state: str, first: int, lines: list[dict[str, Any]]) -> None:
    """Write figures into bench/results, beside those of other groups of the state, and the page."""
    file = RESULTS / f"adversary-{state}.json"
    figures = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    head, *rows = sums(lines)
    for row in rows:
        failed = [line for line in lines if line["name"].split("/")[0] == row[0]]
        failed = [line for line in failed if is_failure(line)]
        failed.sort(key=lambda line: (line["class"] != SILENT, line["class"], line["name"]))
        figures[row[0]] = {
            "first": first,
            "figures": dict(zip(head, row, strict=True)),
            "failures": [describe_failure(line) for line in failed],
        }
    file.write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    page = PAGE.read_text(encoding="utf-8").partition(SECTION)[0]
    PAGE.write_text("\n".join([page.rstrip("\n"), "", *sections()]), encoding="utf-8")


def sections() -> list[str]:
    """Return what the page says of the states that were kept, as lines of Markdown."""
    parts = []
    for file in sorted(RESULTS.glob("adversary-*.json")):
        figures = json.loads(file.read_text(encoding="utf-8"))
        state = file.stem.partition("-")[2]
        head = sums([])[0]
        rows = [
            tuple(group["figures"].get(label, "") for label in head) for group in figures.values()
        ]
        parts += [f"{SECTION}{state}", "", INTRODUCTION.format(state=state)]
        parts += [markdown.table(head, rows, right=range(1, len(head))), "", LIST_INTRODUCTION, ""]
        for name, group in figures.items():
            failures = [f"- {text}" for text in group["failures"]]
            parts += [f"`{name}`, run {group['first']}:", "", *(failures or ["- none"]), ""]
    return parts


def _print(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()

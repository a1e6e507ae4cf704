"""Scenarios: every noise × every excitation × four sensors, many seeded runs a cell.

python -m bench.scenarios --runs 500         the full study; stops and resumes at will
python -m bench.scenarios --runs 20          a look
python -m bench.scenarios --only piezo/shock cells whose name holds the text

The page is studies/scenarios.md; see :mod:`bench.study`.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np

from bench.scenario_bound import bound
from bench.scenario_cells import CELLS, NOISES, Cell, block
from bench.study import Study
from vibrident.show.media import markdown

MAX_BIAS = 0.15  # largest |bias| of a cell, in σ
MAX_SCATTER = 1.10  # largest scatter over the bound
COVERAGE_RANGE = (0.92, 0.98)  # range of the coverage


def table(lines: list[dict], commit: str) -> str:
    """Return the page as Markdown."""
    rows = []
    failures = []
    together = []
    for cell in CELLS:
        cell_lines = [line for line in lines if line["cell"] == cell.name]
        if not cell_lines or not any(line["error"] for line in cell_lines):
            continue
        row, misses, summary = _row(cell, cell_lines)
        rows.append(row)
        if summary is not None:
            together.append(summary)
        if misses:
            failures.append(f"- `{cell.name}`: {'; '.join(misses)}")
    runs = max(
        (sum(line["count"] for line in lines if line["cell"] == cell.name) for cell in CELLS),
        default=0,
    )
    page = [
        "# Every noise, every excitation",
        "",
        f"Written by `python -m bench.scenarios`; do not edit. Runs a cell: up to {runs}; code of "
        f"commit {commit}. By chance alone, one standard deviation: scatter ± "
        f"{100 / np.sqrt(2 * max(runs - 1, 1)):.0f} %, bias ± {1 / np.sqrt(max(runs, 1)):.2f} σ, "
        f"coverage ± {100 * np.sqrt(0.0475 / max(runs, 1)):.0f} %.",
        "",
        "Noise: " + "; ".join(f"**{key}** {words}" for key, (words, _) in NOISES.items()) + ".",
        "Bias in standard deviations of the estimate, scatter over the Cramér–Rao bound of known "
        "noise spectra (`bench/scenario_bound.py`), scatter over the stated u, coverage of the 95 "
        "% intervals; each for gain · natural frequency · damping ratio. For noise **a** nothing "
        "is random: the largest relative error stands instead.",
        "",
        markdown.table(
            ("cell", "bias / σ", "scatter / bound", "scatter / u", "coverage %", "warnings %"), rows
        ),
        "",
    ]
    if together:
        scatter = np.sqrt(np.mean([s[0] ** 2 for s in together]))
        stated = np.sqrt(np.mean([s[1] ** 2 for s in together]))
        covered = 100 * np.mean([s[2] for s in together])
        false = 100 * np.mean([s[3] for s in together])
        page += [
            f"All cells but **a** together: scatter / bound {scatter:.3f}, scatter / u "
            f"{stated:.3f}, coverage {covered:.1f} %, false alarms of `lack_of_fit` {false:.1f} %.",
            "",
        ]
    title = (
        "Cells beyond a target by more than three standard errors of their runs: "
        f"{len(failures)} of {len(rows)}"
    )
    return "\n".join([*page, f"## {title}", "", *(failures or ["None."]), ""])


def _row(
    cell: Cell, lines: list[dict]
) -> tuple[tuple[str, ...], list[str], tuple[float, float, float, float] | None]:
    error = np.array([e for line in lines for e in line["error"]])
    failed = sum(line["failed"] for line in lines)
    misses = [f"{failed} runs failed"] if failed else []
    flags = Counter(code for line in lines for codes in line["flags"] for code in codes)
    codes = (
        ", ".join(f"{code} {100 * count / len(error):.0f}" for code, count in flags.most_common())
        or "–"
    )
    if cell.noise == "a":
        worst = np.max(np.abs(error))
        if worst > 1e-6:
            misses.append(f"relative error {worst:.1e}")
        return (f"`{cell.name}`", f"error {worst:.1e}", "", "", "", codes), misses, None
    u = np.array([e for line in lines for e in line["u"]])
    covered = np.array([e for line in lines for e in line["covered"]], dtype=float)
    runs = len(error)
    scatter = np.std(error, axis=0, ddof=1)
    bias = np.mean(error, axis=0) / scatter
    limit = bound(cell.sensor, cell.excitation, cell.noise)
    assert limit is not None
    over = scatter / limit
    stated = scatter / np.sqrt(np.mean(u**2, axis=0))
    held = np.mean(covered, axis=0)
    chance = 3.0 / np.sqrt(2.0 * max(runs - 1, 1))
    if np.any(np.abs(bias) > MAX_BIAS + 3.0 / np.sqrt(runs)):
        misses.append(f"bias {np.max(np.abs(bias)):.2f} σ")
    if np.any(over > MAX_SCATTER * (1.0 + chance)):
        misses.append(f"scatter {np.max(over):.2f} × the bound")
    slack = 3.0 * np.sqrt(0.0475 / runs)
    if np.any((held < COVERAGE_RANGE[0] - slack) | (held > COVERAGE_RANGE[1] + slack)):
        misses.append(f"coverage {100 * np.min(held):.0f} to {100 * np.max(held):.0f} %")
    cells = (
        _three(bias, "+.2f"),
        _three(over, ".2f"),
        _three(stated, ".2f"),
        _three(100 * held, ".0f"),
    )
    summary = tuple(float(np.sqrt(np.mean(v**2))) for v in (over, stated))
    alarm = flags["lack_of_fit"] / runs
    return (f"`{cell.name}`", *cells, codes), misses, (*summary, float(np.mean(held)), alarm)


def _three(values: np.ndarray, form: str) -> str:
    return " · ".join(format(float(value), form) for value in values)


STUDY = Study("scenarios", __doc__.splitlines()[0], 500, CELLS, block, table)

if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(STUDY.main())

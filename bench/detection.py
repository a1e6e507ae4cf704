"""``python -m bench.detection``: detection rate of a wrong model, and false alarms of a right one.

python -m bench.detection --runs 60          60 seeded runs a cell; stops and resumes at will
python -m bench.detection --only delay/sine  cells whose name holds the text

The page is studies/detection.md; see :mod:`bench.study`.
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict

import numpy as np
from scipy.stats import beta, chi2, ncx2

from bench.detection_cells import (
    CELLS,
    CURVE_PARTS,
    CURVES,
    DEFECTS,
    DETECTION_RATE,
    NOMINAL,
    Cell,
    block,
)
from bench.study import Study
from vibrident.fit.response.verdict import REJECTION
from vibrident.show.media import markdown

CODES = ("lack_of_fit", "nonlinear")
HEAD = """# Detection of a wrong model

Written by `python -m bench.detection`; do not edit. {runs} runs a cell, code of commit {commit}.

Each sensor has a defect that the fitted model, `accelerometer`, lacks:

{defects}

Sines: twelve tones over the band, 4000 samples each. Random and sweep: two records of 4000 samples
over the band. All at 1 g (random: its rms). The noise of the response is white, 1 % or 0.1 % of
each record's rms. A cell is met if at least 95 % of its runs carry `lack_of_fit`, or `nonlinear`
for the spring, whose distortion is detected too.

**λ** is the strength of the defect: λ² is its contribution to χ², the squared misfit after the best
fit, over the noise. Detection depends only on it and on the degrees of freedom ν; 95 % needs λ =
{few:.1f} for ν = 21 and λ = {many:.1f} for ν = 150.
"""


def table(lines: list[dict], commit: str) -> str:
    """Return the page as Markdown."""
    by_cell = defaultdict(list)
    for line in lines:
        by_cell[line["cell"]].append(line)
    counts = {
        name: sum(line["count"] for line in cell_lines) for name, cell_lines in by_cell.items()
    }
    runs = f"{min(counts.values())} to {max(counts.values())}" if counts else "0"
    if counts and min(counts.values()) == max(counts.values()):
        runs = str(min(counts.values()))
    defects = "\n".join(
        f"- **{d.name}**: {d.title}; {d.write(d.nominal)} at first." for d in DEFECTS.values()
    )
    page = [
        HEAD.format(runs=runs, commit=commit, defects=defects, few=_needed(21), many=_needed(150))
    ]
    page += _nominal(by_cell) + _curves(by_cell) + _alarms(by_cell)
    return "\n".join([*page, ""])


def _needed(degrees: int) -> float:
    power = np.geomspace(1.0, 1e3, 20_000)
    return float(
        np.sqrt(
            power[
                np.argmax(ncx2.sf(chi2.isf(REJECTION, degrees), degrees, power) >= DETECTION_RATE)
            ]
        )
    )


def _nominal(by_cell: dict[str, list[dict]]) -> list[str]:
    rows = []
    missed = []
    shown = 0
    for cell in NOMINAL:
        cell_lines = by_cell.get(cell.name)
        if not cell_lines:
            continue
        shown += 1
        flags = _flags(cell_lines)
        strength = _strength(cell_lines)
        counted = [sum(code in codes for codes in flags) for code in CODES]
        flagged = sum(
            bool(set(codes) & set(CODES[: 2 if cell.defect == "cubic" else 1])) for codes in flags
        )
        low = 100.0 * float(beta.ppf(0.05, flagged, len(flags) - flagged + 1)) if flagged else 0.0
        if flagged < DETECTION_RATE * len(flags):
            missed.append(f"`{cell.defect}/{cell.excitation}` at {100 * cell.noise:g} %")
        rows.append(
            (
                f"{cell.defect}, {DEFECTS[cell.defect].write(cell.size)}",
                *(
                    cell.excitation,
                    f"{100 * cell.noise:g} %",
                    strength,
                    str(counted[0]),
                    str(counted[1]),
                ),
                *(f"{flagged} of {len(flags)}", f"{low:.1f} %"),
            )
        )
    verdict = f"Missed: {', '.join(missed)}." if missed else f"All {shown} met."
    return [
        "## The defects that must be found",
        "",
        "The last column is the lower limit of the rate at 95 % confidence (Clopper and Pearson).",
        "",
        markdown.table(
            (
                "defect",
                "motion",
                "noise",
                "λ",
                "`lack_of_fit`",
                "`nonlinear`",
                "detected",
                "rate above",
            ),
            rows,
            right=range(3, 8),
        ),
        "",
        f"At least 95 % of the runs detected: {shown - len(missed)} of {shown} cells. {verdict}",
        "",
    ]


def _curves(by_cell: dict[str, list[dict]]) -> list[str]:
    rows = []
    parts = [fraction for fraction in CURVE_PARTS if fraction > 0.0]
    for first in (cell for cell in CURVES if cell.part == parts[0]):
        cells = [Cell(first.defect, first.excitation, first.noise, fraction) for fraction in parts]
        cell_lines = {cell.part: by_cell[cell.name] for cell in cells if by_cell.get(cell.name)}
        if len(cell_lines) < len(parts):
            continue
        unit = cell_lines[1.0][0]["size"]
        defect = DEFECTS[first.defect]
        start = (first.defect, first.excitation, defect.write(unit) if unit else "–")
        if not unit:
            rows.append((*start, *("–" for _ in parts)))
            continue
        cells_of_row = []
        for fraction in parts:
            flags = _flags(cell_lines[fraction])
            lack_count = sum("lack_of_fit" in codes for codes in flags)
            either = sum(bool(set(codes) & set(CODES)) for codes in flags)
            remark = f" ({either})" if first.defect == "cubic" and either != lack_count else ""
            met = f"λ {_strength(cell_lines[fraction])}, {_expected(cell_lines[fraction])}"
            cells_of_row.append(f"{lack_count} of {len(flags)}{remark}; {met}")
        rows.append((*start, *cells_of_row))
    return [
        "## Smallest detected defect, with 1 % of noise",
        "",
        "The size is the one that the χ² test should find in 95 of 100 runs, as trial runs have "
        "it; beside it, for",
        "parts and multiples of that size: runs with `lack_of_fit` (in brackets: with that or "
        "`nonlinear`); the λ that",
        "was met, and the rate that the χ² test should have at that λ. No size: the nominal "
        "defect adds less.",
        "",
        markdown.table(
            ("defect", "motion", "size", *(f"× {fraction:g}" for fraction in parts)), rows
        ),
        "",
    ]


def _alarms(by_cell: dict[str, list[dict]]) -> list[str]:
    rows = []
    total = 0
    alarms = [0, 0]
    listed = set()
    for cell in (cell for cell in CURVES if cell.part == 0.0):
        sensor = "micromechanical, 4 kHz" if cell.defect == "boxcar" else "paper, Table 2"
        cell_lines = by_cell.get(cell.name)
        key = (sensor, cell.excitation, cell.noise)
        # The sensors of three defects are the same without them, run by run.
        if not cell_lines or key in listed:
            continue
        listed.add(key)
        flags = _flags(cell_lines)
        counted = [sum(code in codes for codes in flags) for code in CODES]
        total += len(flags)
        alarms = [a + b for a, b in zip(alarms, counted, strict=True)]
        rows.append(
            (
                sensor,
                cell.excitation,
                f"{100 * cell.noise:g} %",
                str(counted[0]),
                str(counted[1]),
                str(len(flags)),
            )
        )
    high = [100.0 * float(beta.ppf(0.95, a + 1, total - a)) if total > a else 100.0 for a in alarms]
    return [
        "## False alarms",
        "",
        "The same sensors without a defect. The test's level is 0.1 %.",
        "",
        markdown.table(
            ("sensor", "motion", "noise", "`lack_of_fit`", "`nonlinear`", "runs"),
            rows,
            right=(3, 4, 5),
        ),
        "",
        f"Together: `lack_of_fit` in {alarms[0]} of {total} runs (below {high[0]:.2g} % at 95 % "
        f"confidence), `nonlinear` in {alarms[1]} (below {high[1]:.2g} %).",
    ]


def _flags(lines: list[dict]) -> list[list[str]]:
    return [codes for line in lines for codes in line["flags"]]


def _moments(lines: list[dict]) -> tuple[float, float]:
    """Mean of χ² less its degrees of freedom, and mean degrees of freedom."""
    chi = np.array([value for line in lines for value in line["chi2"]], dtype=float)
    degrees = np.array([value for line in lines for value in line["degrees"]], dtype=float)
    return float(np.mean(chi - degrees)), float(np.mean(degrees))


def _strength(lines: list[dict]) -> str:
    added, _ = _moments(lines)
    return f"{math.sqrt(added):.3g}" if added > 0.0 else "0"


def _expected(lines: list[dict]) -> str:
    added, degrees = _moments(lines)
    rate = float(ncx2.sf(chi2.isf(REJECTION, degrees), degrees, max(added, 1e-9)))
    return f"{100 * rate:.0f} %"


STUDY = Study("detection", __doc__.splitlines()[0], 200, CELLS, block, table)

if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(STUDY.main())

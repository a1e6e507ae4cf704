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

from bench.detection_cells import CELLS, CURVE, CURVES, DEFECTS, DETECTED, NOMINAL, Cell, block
from bench.study import Study
from vibrident.fit.response.verdict import REJECTION
from vibrident.show.media import markdown

CODES = ("lack_of_fit", "nonlinear")
HEAD = """# Detection of a wrong model

Written by `python -m bench.detection`; do not edit. {runs} runs a cell, code of commit {commit}.

Each sensor has a defect that the fitted model, `accelerometer`, lacks:

{defects}

Sines: twelve tones over the band, 4000 samples each. Random and sweep: two records of 4000 samples over the band. All
at 1 g (random: its rms). The noise of the response is white, 1 % or 0.1 % of each record's rms. A cell is met if at
least 95 % of its runs carry `lack_of_fit`, or `nonlinear` for the spring, whose distortion is detected too.

**λ** is the strength of the defect: λ² is its contribution to χ², the squared misfit after the best fit, over the
noise. Detection depends only on it and on the degrees of freedom ν; 95 % needs λ = {few:.1f} for ν = 21 and
λ = {many:.1f} for ν = 150.
"""


def table(lines: list[dict], commit: str) -> str:
    """The page as Markdown."""
    found = defaultdict(list)
    for line in lines:
        found[line["cell"]].append(line)
    counts = {name: sum(line["count"] for line in own) for name, own in found.items()}
    runs = f"{min(counts.values())} to {max(counts.values())}" if counts else "0"
    if counts and min(counts.values()) == max(counts.values()):
        runs = str(min(counts.values()))
    defects = "\n".join(f"- **{d.name}**: {d.title}; {d.write(d.nominal)} at first." for d in DEFECTS.values())
    page = [HEAD.format(runs=runs, commit=commit, defects=defects, few=_needed(21), many=_needed(150))]
    page += _nominal(found) + _curves(found) + _alarms(found)
    return "\n".join([*page, ""])


def _needed(degrees: int) -> float:
    power = np.geomspace(1.0, 1e3, 20_000)
    return float(np.sqrt(power[np.argmax(ncx2.sf(chi2.isf(REJECTION, degrees), degrees, power) >= DETECTED)]))


def _nominal(found: dict[str, list[dict]]) -> list[str]:
    rows, missed, shown = [], [], 0
    for cell in NOMINAL:
        own = found.get(cell.name)
        if not own:
            continue
        shown += 1
        flags, strength = _flags(own), _strength(own)
        counted = [sum(code in codes for codes in flags) for code in CODES]
        whole = sum(bool(set(codes) & set(CODES[: 2 if cell.defect == "cubic" else 1])) for codes in flags)
        low = 100.0 * float(beta.ppf(0.05, whole, len(flags) - whole + 1)) if whole else 0.0
        if whole < DETECTED * len(flags):
            missed.append(f"`{cell.defect}/{cell.excitation}` at {100 * cell.noise:g} %")
        rows.append(
            (
                f"{cell.defect}, {DEFECTS[cell.defect].write(cell.size)}",
                *(cell.excitation, f"{100 * cell.noise:g} %", strength, str(counted[0]), str(counted[1])),
                *(f"{whole} of {len(flags)}", f"{low:.1f} %"),
            )
        )
    verdict = f"Missed: {', '.join(missed)}." if missed else f"All {shown} met."
    return [
        "## The defects that must be found",
        "",
        "The last column is the lower limit of the rate at 95 % confidence (Clopper and Pearson).",
        "",
        markdown.table(
            ("defect", "motion", "noise", "λ", "`lack_of_fit`", "`nonlinear`", "detected", "rate above"),
            rows,
            right=range(3, 8),
        ),
        "",
        f"At least 95 % of the runs detected: {shown - len(missed)} of {shown} cells. {verdict}",
        "",
    ]


def _curves(found: dict[str, list[dict]]) -> list[str]:
    rows = []
    parts = [part for part in CURVE if part > 0.0]
    for first in (cell for cell in CURVES if cell.part == parts[0]):
        cells = [Cell(first.defect, first.excitation, first.noise, part) for part in parts]
        own = {cell.part: found[cell.name] for cell in cells if found.get(cell.name)}
        if len(own) < len(parts):
            continue
        unit = own[1.0][0]["size"]
        defect = DEFECTS[first.defect]
        start = (first.defect, first.excitation, defect.write(unit) if unit else "–")
        if not unit:
            rows.append((*start, *("–" for _ in parts)))
            continue
        cells_of_row = []
        for part in parts:
            flags = _flags(own[part])
            said = sum("lack_of_fit" in codes for codes in flags)
            either = sum(bool(set(codes) & set(CODES)) for codes in flags)
            beside = f" ({either})" if first.defect == "cubic" and either != said else ""
            met = f"λ {_strength(own[part])}, {_expected(own[part])}"
            cells_of_row.append(f"{said} of {len(flags)}{beside}; {met}")
        rows.append((*start, *cells_of_row))
    return [
        "## Smallest detected defect, with 1 % of noise",
        "",
        "The size is the one that the χ² test should find in 95 of 100 runs, as trial runs have it; beside it, for",
        "parts and multiples of that size: runs with `lack_of_fit` (in brackets: with that or `nonlinear`); the λ that",
        "was met, and the rate that the χ² test should have at that λ. No size: the nominal defect adds less.",
        "",
        markdown.table(("defect", "motion", "size", *(f"× {part:g}" for part in parts)), rows),
        "",
    ]


def _alarms(found: dict[str, list[dict]]) -> list[str]:
    rows, total, alarms = [], 0, [0, 0]
    seen = set()
    for cell in (cell for cell in CURVES if cell.part == 0.0):
        sensor = "micromechanical, 4 kHz" if cell.defect == "boxcar" else "paper, Table 2"
        own = found.get(cell.name)
        key = (sensor, cell.excitation, cell.noise)
        if not own or key in seen:  # the sensors of three defects are the same without them, run by run
            continue
        seen.add(key)
        flags = _flags(own)
        counted = [sum(code in codes for codes in flags) for code in CODES]
        total += len(flags)
        alarms = [a + b for a, b in zip(alarms, counted, strict=True)]
        rows.append(
            (sensor, cell.excitation, f"{100 * cell.noise:g} %", str(counted[0]), str(counted[1]), str(len(flags)))
        )
    high = [100.0 * float(beta.ppf(0.95, a + 1, total - a)) if total > a else 100.0 for a in alarms]
    return [
        "## False alarms",
        "",
        "The same sensors without a defect. The test's level is 0.1 %.",
        "",
        markdown.table(("sensor", "motion", "noise", "`lack_of_fit`", "`nonlinear`", "runs"), rows, right=(3, 4, 5)),
        "",
        f"Together: `lack_of_fit` in {alarms[0]} of {total} runs (below {high[0]:.2g} % at 95 % confidence), "
        f"`nonlinear` in {alarms[1]} (below {high[1]:.2g} %).",
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

"""``python -m bench.detection``: how often a wrong model is found out, and a right one is not suspected.

python -m bench.detection --runs 60          60 seeded runs a cell; stops and resumes at will
python -m bench.detection --only delay/sine  cells whose name holds the text

Runs are kept in bench/results/detection.jsonl, a line a block, so that a study goes on where it was stopped; the tables
are written to docs/detection.md. A line belongs to the commit it was made at: runs of another commit are not counted.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

from bench.detection_cells import CELLS, Cell, block
from bench.detection_table import table
from bench.progress import STDERR, steps

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "bench" / "results" / "detection.jsonl"
PAGE = ROOT / "docs" / "detection.md"
#: Runs in a block: what is lost at most where a study is stopped.
BLOCK = 10


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing, then write the tables of all there is."""
    parser = argparse.ArgumentParser(prog="python -m bench.detection", description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="seeded runs a cell")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--only", default="", metavar="TEXT", help="cells whose name holds this")
    parser.add_argument("--trial", action="store_true", help="print the tables; keep nothing, publish nothing")
    parser.add_argument("--of", default="", metavar="COMMIT", help="run nothing; publish what was kept of this commit")
    given = parser.parse_args(arguments)
    commit = given.of or _commit()
    kept = [] if given.trial else list(_kept(commit))
    done = {(line["cell"], line["first"]) for line in kept}
    wanted = [
        (cell, first, min(BLOCK, given.runs - first))
        for first in range(0, given.runs, BLOCK)
        for cell in CELLS
        if not given.of and given.only in cell.name and (cell.name, first) not in done
    ]
    for line in steps("detection", _blocks(wanted, given.jobs), total=len(wanted)):
        line["commit"] = commit
        kept.append(line)
        if not given.trial:
            KEPT.parent.mkdir(parents=True, exist_ok=True)
            with KEPT.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(line) + "\n")
    page = table(kept, commit)
    if given.trial:
        sys.stdout.write(page)
    else:
        PAGE.write_text(page, encoding="utf-8")
        STDERR.print(f"written: {PAGE}", soft_wrap=True)
    return 0


def _blocks(wanted: list[tuple[Cell, int, int]], jobs: int) -> Iterator[dict]:
    if jobs == 1:
        return (block(cell.name, first, count) for cell, first, count in wanted)
    parallel = Parallel(n_jobs=jobs, backend="loky", return_as="generator_unordered", pre_dispatch="2*n_jobs")
    return parallel(delayed(block)(cell.name, first, count) for cell, first, count in wanted)


def _kept(commit: str) -> Iterator[dict]:
    if KEPT.exists():
        for text in KEPT.read_text(encoding="utf-8").splitlines():
            line = json.loads(text)
            if line["commit"] == commit:
                yield line


def _commit() -> str:
    """The last commit that changed the package or this study."""
    command = ["git", "log", "-1", "--format=%h", "--", "src", "bench/detection_cells.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(main())

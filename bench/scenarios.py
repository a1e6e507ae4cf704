"""``python -m bench.scenarios``: every noise × every excitation × four sensors, many seeded runs a cell.

python -m bench.scenarios --runs 500         the full study; stops and resumes at will
python -m bench.scenarios --runs 20          a look
python -m bench.scenarios --only piezo/shock cells whose name holds the text

Runs are kept in bench/results/scenarios.jsonl, a line a block, so that a study goes on where it was stopped; the table
is written to docs/scenarios.md. A line belongs to the commit it was made at: runs of another commit are not counted.
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

from bench.progress import STDERR, steps
from bench.scenario_cells import CELLS, Cell, block
from bench.scenario_table import table

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "bench" / "results" / "scenarios.jsonl"
PAGE = ROOT / "docs" / "scenarios.md"
#: Runs in a block: what is lost at most where a study is stopped.
BLOCK = 10


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing, then write the table of all there is."""
    parser = argparse.ArgumentParser(prog="python -m bench.scenarios", description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=500, help="seeded runs a cell")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--only", default="", metavar="TEXT", help="cells whose name holds this")
    parser.add_argument("--trial", action="store_true", help="print the table; keep nothing, publish nothing")
    parser.add_argument("--of", default="", metavar="COMMIT", help="run nothing; publish what was kept of this commit")
    given = parser.parse_args(arguments)
    commit = given.of or _commit()
    kept = [] if given.trial else list(_kept(commit))
    done = {(line["cell"], line["first"]) for line in kept}
    wanted = [
        (cell, first, min(BLOCK, cell.runs(given.runs) - first))
        for first in range(0, given.runs, BLOCK)
        for cell in CELLS
        if not given.of and given.only in cell.name and first < cell.runs(given.runs) and (cell.name, first) not in done
    ]
    for line in steps("scenarios", _blocks(wanted, given.jobs), total=len(wanted)):
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
    """The last commit that changed the package or these studies."""
    command = ["git", "log", "-1", "--format=%h", "--", "src", "bench/scenario_cells.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


if __name__ == "__main__":
    np.seterr(all="ignore")
    sys.exit(main())

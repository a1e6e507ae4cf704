"""``python -m bench.adversary``: random sensors, motions and defects, against the truth.

python -m bench.adversary --runs 1               every case once; stops and resumes at will
python -m bench.adversary --only clean/in        cases whose name holds the text
python -m bench.adversary --list                 names of the cases
python -m bench.adversary --repeat-failures      run failures of the last code again; keep nothing
python -m bench.adversary --show NAME [--run 2]  one case in detail
python -m bench.adversary --groups clocks held   groups alone, printed: [--first 34] [--runs 1]
                                                 [--cases N] of each [--only TEXT] [--limit CPU-S]
                                                 [--keep before]

The page is studies/adversary.md; see :mod:`bench.study`.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from bench.adversary import groups
from bench.adversary.cases import BY_NAME, CASES
from bench.adversary.judge import BAD, judged, quiet
from bench.adversary.table import table
from bench.study import ROOT, Study


def block(name: str, runs: range) -> dict[str, Any]:
    """Some runs of a case."""
    quiet()
    return {"runs": [judged(BY_NAME[name].trial(run)) for run in runs]}


STUDY = Study("adversary", __doc__.splitlines()[0], 1, CASES, block, table)


def main(arguments: list[str]) -> int:
    """Return what the study does not do itself: groups, list, show, and run the failures again."""
    if "--groups" in arguments:
        return groups.main(arguments)
    only = _after(arguments, "--only")
    if "--list" in arguments:
        sys.stdout.write("".join(f"{name}\n" for name in sorted(BY_NAME) if only in name))
        return 0
    if "--show" in arguments:
        run = int(_after(arguments, "--run") or 0)
        for name in (case.name for case in CASES if _after(arguments, "--show") in case.name):
            quiet()
            _print(name, run, judged(BY_NAME[name].trial(run)))
        return 0
    if "--repeat-failures" in arguments:
        quiet()
        for name, run in _failed(only):
            _print(name, run, judged(BY_NAME[name].trial(run)))
        return 0
    return STUDY.main(arguments)


def _after(arguments: list[str], option: str) -> str:
    return arguments[arguments.index(option) + 1] if option in arguments else ""


def _failed(only: str) -> list[tuple[str, int]]:
    """Cases and runs that failed when they were last run."""
    last: dict[tuple[str, int], str] = {}
    file = ROOT / "bench" / "results" / "adversary.jsonl"
    for text in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
        line = json.loads(text)
        for run, outcome in enumerate(line["runs"], line["first"]):
            last[line["cell"], run] = outcome["class"]
    return [
        key for key, kind in last.items() if kind in BAD and key[0] in BY_NAME and only in key[0]
    ]


def _print(name: str, run: int, outcome: dict[str, Any]) -> None:
    sys.stdout.write(f"{outcome['class']:13} {name} run {run}: {json.dumps(outcome)}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

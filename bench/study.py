"""A study of many seeded runs in cells: stopped and resumed at will, its page written from what was kept.

Runs are kept a line a block, so that a study goes on where it was stopped. A line belongs to the commit that the
package and the cells were last changed by. Runs of another commit count where they are asked for (``--with``) and what
both commits have run, in that cell, gave the same.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from joblib import Parallel, delayed

from bench.progress import STDERR, steps

ROOT = Path(__file__).resolve().parents[1]
#: Runs in a block: what is lost at most where a study is stopped.
BLOCK = 10
#: Numbers of repeated runs agree to this part of the largest of them.
ALIKE = 1e-3


class Cell(Protocol):
    """One combination of what is varied."""

    @property
    def name(self) -> str:
        """For files and the command line."""
        ...

    def runs(self, asked: int) -> int:
        """How many runs it needs where so many are asked for."""
        ...


@dataclass(frozen=True)
class Study:
    """A study and its command line.

    Attributes:
        name: of the module; of the file of runs, bench/results/<name>.jsonl, and the page, docs/<name>.md.
        title: for ``--help``.
        runs: a cell, unless asked otherwise.
        cells: all of them.
        block: name of a cell, first run and number of runs, to a line to keep.
        table: kept lines and their commit, to the page.
    """

    name: str
    title: str
    runs: int
    cells: Sequence[Cell]
    block: Callable[[str, int, int], dict[str, Any]]
    table: Callable[[list[dict[str, Any]], str], str]

    def main(self, arguments: list[str] | None = None) -> int:
        """Run what is missing, then write the page of all there is."""
        given = self._parser().parse_args(arguments)
        shown = commit = given.of or self._commit()
        kept = [] if given.trial else list(self._kept(commit))
        if given.also and not given.trial:
            more, cells = _taken_over(kept, list(self._kept(given.also)))
            kept += more
            shown = f"{commit} (in {cells} cells also of {given.also}: what both had run gave the same)"
        done = {(line["cell"], line["first"]) for line in kept}
        wanted = [
            (cell.name, first, min(BLOCK, cell.runs(given.runs) - first))
            for first in range(0, given.runs, BLOCK)
            for cell in self.cells
            if not given.of and given.only in cell.name and first < cell.runs(given.runs)
        ]
        wanted = [block for block in wanted if block[:2] not in done]
        for line in steps(self.name, self._blocks(wanted, given.jobs), total=len(wanted)):
            line["commit"] = commit
            kept.append(line)
            if not given.trial:
                self._keep(line)
        page = self.table(kept, shown)
        if given.trial:
            sys.stdout.write(page)
        else:
            target = ROOT / "docs" / f"{self.name}.md"
            target.write_text(page, encoding="utf-8")
            STDERR.print(f"written: {target}", soft_wrap=True)
        return 0

    def _parser(self) -> argparse.ArgumentParser:
        parser = argparse.ArgumentParser(prog=f"python -m bench.{self.name}", description=self.title)
        parser.add_argument("--runs", type=int, default=self.runs, help="seeded runs a cell")
        parser.add_argument("--jobs", type=int, default=2, help="processes")
        parser.add_argument("--only", default="", metavar="TEXT", help="cells whose name holds this")
        parser.add_argument("--trial", action="store_true", help="print the page; keep nothing, publish nothing")
        parser.add_argument("--of", default="", metavar="COMMIT", help="run nothing; publish what was kept of it")
        parser.add_argument(
            "--with", dest="also", default="", metavar="COMMIT", help="count its runs, too, where repeated ones agree"
        )
        return parser

    def _blocks(self, wanted: list[tuple[str, int, int]], jobs: int) -> Iterable[Any]:
        if jobs == 1:
            return (self.block(*block) for block in wanted)
        parallel = Parallel(n_jobs=jobs, backend="loky", return_as="generator_unordered", pre_dispatch="2*n_jobs")
        return parallel(delayed(self.block)(*block) for block in wanted)

    @property
    def _file(self) -> Path:
        return ROOT / "bench" / "results" / f"{self.name}.jsonl"

    def _kept(self, commit: str) -> Iterator[dict[str, Any]]:
        if self._file.exists():
            for text in self._file.read_text(encoding="utf-8").splitlines():
                line = json.loads(text)
                if line["commit"] == commit:
                    yield line

    def _keep(self, line: dict[str, Any]) -> None:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(line) + "\n")

    def _commit(self) -> str:
        """The last commit that changed the package or the cells."""
        cells = sys.modules[self.block.__module__].__file__ or ""
        cells = cells.removesuffix("/__main__.py")  # of a study in several modules, all of them
        command = ["git", "log", "-1", "--format=%h", "--", "src", cells]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        return done.stdout.strip() or "unknown"


def _taken_over(kept: list[dict[str, Any]], others: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], int]:
    """Lines of another commit that may stand beside those kept, and in how many cells there are any."""
    known = {(line["cell"], line["first"]): line for line in kept}
    agrees: dict[str, bool] = {}
    for line in others:
        twin = known.get((line["cell"], line["first"]))
        if twin is not None:
            agrees[line["cell"]] = agrees.get(line["cell"], True) and _same(line, twin)
    more = [one for one in others if agrees.get(one["cell"]) and (one["cell"], one["first"]) not in known]
    return more, len({one["cell"] for one in more})


def _same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two lines hold the same runs with the same outcome, numbers to a thousandth of their size."""
    for key in one.keys() - {"commit"}:
        first, second = (
            np.array(line[key], dtype=float) if _numeric(line[key]) else line[key] for line in (one, other)
        )
        if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
            size = ALIKE * float(np.max(np.abs(second), initial=0.0))
            if first.shape != second.shape or not np.allclose(first, second, rtol=ALIKE, atol=size):
                return False
        elif first != second:
            return False
    return True


def _numeric(value: Any) -> bool:
    return np.asarray(value, dtype=object).size > 0 and all(
        isinstance(number, (int, float)) for number in np.ravel(np.asarray(value, dtype=object))
    )

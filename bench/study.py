"""Study of many seeded runs in cells, stopped and resumed at will, with a page of the figures.

Runs are kept a line a block, so that a study goes on where it was stopped. A line belongs to the
commit that the package and the cells were last changed by; a page is made of the lines of one
commit.
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

from joblib import Parallel, delayed

from bench.figures import STDERR, steps

ROOT = Path(__file__).resolve().parents[1]
RUNS_PER_BLOCK = 10  # runs in a block: what is lost at most where a study is stopped


class Cell(Protocol):
    """Combination of what is varied."""

    @property
    def name(self) -> str:
        """Return the name for files and the command line."""
        ...

    def runs(self, requested: int) -> int:
        """Return how many runs it needs where so many are asked for."""
        ...


@dataclass(frozen=True)
class Study:
    """A study and its command line.

    Attributes:
        name: of the module; of the file of runs, bench/results/<name>.jsonl, and the page,
            studies/<name>.md.
        title: for ``--help``.
        runs: a cell, unless asked otherwise.
        cells: all of them.
        block: name of a cell and numbers of runs, to what is kept of them, beside these.
        table: kept lines and their commit, to the page.
    """

    name: str
    title: str
    runs: int
    cells: Sequence[Cell]
    block: Callable[[str, range], dict[str, Any]]
    table: Callable[[list[dict[str, Any]], str], str]

    def main(self, arguments: list[str] | None = None) -> int:
        """Run what is missing, then write the page of all there is."""
        options = self._parser().parse_args(arguments)
        commit = options.of or self._commit()
        lines = [] if options.trial else list(self._stored_lines(commit))
        done = {(line["cell"], line["first"]) for line in lines}
        wanted = [
            (cell.name, options.first + first, min(RUNS_PER_BLOCK, cell.runs(options.runs) - first))
            for first in range(0, options.runs, RUNS_PER_BLOCK)
            for cell in self.cells
            if not options.of and options.only in cell.name and first < cell.runs(options.runs)
        ]
        wanted = [block for block in wanted if block[:2] not in done]
        for line in steps(self.name, self._blocks(wanted, options.jobs), total=len(wanted)):
            line["commit"] = commit
            lines.append(line)
            if not options.trial:
                self._keep(line)
        page = self.table(lines, commit)
        if options.trial:
            sys.stdout.write(page)
        else:
            target = ROOT / "studies" / f"{self.name}.md"
            target.write_text(page, encoding="utf-8")
            STDERR.print(f"written: {target}", soft_wrap=True)
        return 0

    def _parser(self) -> argparse.ArgumentParser:
        parser = argparse.ArgumentParser(
            prog=f"python -m bench.{self.name}", description=self.title
        )
        parser.add_argument("--runs", type=int, default=self.runs, help="seeded runs a cell")
        parser.add_argument(
            "--first",
            type=int,
            default=0,
            help="seed of the first: others than the package was tried on",
        )
        parser.add_argument("--jobs", type=int, default=2, help="processes")
        parser.add_argument(
            "--only", default="", metavar="TEXT", help="cells whose name holds this"
        )
        parser.add_argument(
            "--trial", action="store_true", help="print the page; keep nothing, publish nothing"
        )
        parser.add_argument(
            "--of", default="", metavar="COMMIT", help="run nothing; publish what was kept of it"
        )
        return parser

    def _blocks(self, wanted: list[tuple[str, int, int]], jobs: int) -> Iterable[Any]:
        if jobs == 1:
            return (_line(self.block, *block) for block in wanted)
        parallel = Parallel(
            n_jobs=jobs, backend="loky", return_as="generator_unordered", pre_dispatch="2*n_jobs"
        )
        return parallel(delayed(_line)(self.block, *block) for block in wanted)

    @property
    def _file(self) -> Path:
        return ROOT / "bench" / "results" / f"{self.name}.jsonl"

    def _stored_lines(self, commit: str) -> Iterator[dict[str, Any]]:
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
        """Return the last commit that changed the package or the cells."""
        cells = sys.modules[self.block.__module__].__file__ or ""
        cells = cells.removesuffix("/__main__.py")  # of a study in several modules, all of them
        command = ["git", "log", "-1", "--format=%h", "--", "src", cells]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        return done.stdout.strip() or "unknown"


def _line(
    block: Callable[[str, range], dict[str, Any]], cell: str, first: int, count: int
) -> dict[str, Any]:
    """Return what is kept of some runs of a cell."""
    return {
        "cell": cell,
        "first": first,
        "count": count,
        **block(cell, range(first, first + count)),
    }

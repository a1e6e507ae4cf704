"""Fleets that run in this process, with the processes that it starts."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from tests.support.fleets import DEADLY

from vibrident.lab.fleet import LocalScheduler, Orders, Outcome, RunRequest, run, worker
from vibrident.lab.fleet.batch import Identifier

Run = Callable[..., Outcome]


@pytest.fixture(scope="session")
def run_fleet() -> Run:
    """Run a fleet, with one process unless it is asked for more."""

    def run_(patterns: list[Path], out: Path, *, workers: int = 1, fresh: bool = False, **orders: object) -> Outcome:
        return run(
            RunRequest([str(one) for one in patterns], Orders(str(out), **orders), fresh=fresh), LocalScheduler(workers)
        )  # type: ignore[arg-type]

    return run_


@pytest.fixture
def hashed_here(monkeypatch) -> None:
    """Calibrations are hashed in this process: a run that computes nothing starts none."""
    monkeypatch.setattr(Identifier, "fingerprints", lambda self, paths: worker.fingerprints(paths, self.orders))


@pytest.fixture
def here(monkeypatch, hashed_here) -> None:
    """Calibrations are identified in this process: for what does not depend on where that is."""
    monkeypatch.setattr(Identifier, "identify", lambda self, tasks: worker.identified(tasks, self.orders)[0])


@pytest.fixture
def pageless(monkeypatch) -> None:
    """No page is drawn at the end of a run: for what looks at the rows alone."""
    monkeypatch.setattr("vibrident.lab.fleet.coordinator.write_page", lambda path, *_: path)


@pytest.fixture(scope="session")
def rows() -> Callable[[Path], list[dict]]:
    """Rows of a fleet's table."""
    return lambda out: pq.read_table(out / "fleet.parquet").to_pylist()


@pytest.fixture(scope="module")
def deadly_site(tmp_path_factory) -> str:
    """A folder that, on the path of Python, makes some calibrations end their process."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "sitecustomize.py").write_text(DEADLY, encoding="utf-8")
    sys.path.insert(0, str(folder))
    yield str(folder)
    sys.path.remove(str(folder))

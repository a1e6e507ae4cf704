"""The same fleet on a Dask cluster of processes started from a shell, one of them killed and one added meanwhile."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.support.fleets import broken, deadly, fleet

from vibrident.base.errors import InputError
from vibrident.lab.fleet import Dask, Orders, RunRequest, run

needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="Dask is not installed (pip install 'vibrident[cluster]')"
)


class Cluster:
    """A scheduler and its workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "scheduler.json"
        self.processes: list[subprocess.Popen[bytes]] = []
        self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show")

    def add(self) -> subprocess.Popen[bytes]:
        return self._start("worker", "--nthreads", "1", "--no-dashboard", "--no-nanny", "--host", "127.0.0.1")

    def _start(self, *what: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", *what, "--scheduler-file", str(self.file)]
        log = (self.file.parent / f"{len(self.processes)}.log").open("wb")
        with log:
            process = subprocess.Popen(command, stdout=log, stderr=log, cwd=self.file.parent)
        self.processes.append(process)
        until = time.monotonic() + 60
        while what[0] == "scheduler" and not self.file.is_file() and time.monotonic() < until:
            time.sleep(0.1)
        return process

    def end(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path) -> Iterator[Cluster]:
    made = Cluster(tmp_path)
    yield made
    made.end()


@needs_dask
@pytest.mark.filterwarnings("default")  # Dask's own, of what it uses
def test_a_cluster_gives_the_table_of_this_machine(tmp_path, run_fleet, rows, here, pageless):
    """Scheduler and worker are threads here."""
    import distributed

    fleet(tmp_path / "data/good", 3)
    broken(tmp_path / "data/broken")
    local = run_fleet([tmp_path / "data"], tmp_path / "local")
    asked = RunRequest([str(tmp_path / "data")], Orders(str(tmp_path / "dask")))
    with distributed.LocalCluster(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        assert run(asked, Dask(cluster.scheduler_address)).tally.statuses == local.tally.statuses
    assert [_numbers(row) for row in rows(tmp_path / "dask")] == [_numbers(row) for row in rows(tmp_path / "local")]


@pytest.mark.slow
@needs_dask
@pytest.mark.filterwarnings("default")
def test_a_cluster_that_loses_and_gains_a_worker_gives_the_same_table(
    tmp_path, cluster, deadly_site, run_fleet, rows, monkeypatch, pageless
):
    data = fleet(tmp_path / "data/good", 12)
    broken(tmp_path / "data/broken")
    deadly(tmp_path / "data/deadly", *(f"{number}-slow" for number in range(6)))
    local = run_fleet([tmp_path / "data"], tmp_path / "local")
    paths = os.pathsep.join([deadly_site, os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", paths)
    first = cluster.add()
    cluster.add()
    seen: list[int] = []

    def meanwhile(progress) -> None:
        if progress.workers and not seen and list((tmp_path / "dask/parts").glob("*.parquet")):
            seen.append(progress.done)
            cluster.add()
            first.send_signal(signal.SIGKILL)

    outcome = run(
        RunRequest([str(tmp_path / "data")], Orders(str(tmp_path / "dask"))), Dask(str(cluster.file)), meanwhile
    )
    assert seen
    assert seen[0] < outcome.tally.rows
    assert outcome.tally.statuses == local.tally.statuses
    assert [_numbers(row) for row in rows(tmp_path / "dask")] == [_numbers(row) for row in rows(tmp_path / "local")]
    assert data.is_dir()


@pytest.mark.slow
@needs_dask
@pytest.mark.filterwarnings("default")
def test_a_scheduler_that_is_killed_is_said_and_nothing_is_lost(
    tmp_path, cluster, deadly_site, run_fleet, monkeypatch, pageless
):
    deadly(tmp_path / "data", "segfault", *(f"{number}-slow" for number in range(10)))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([deadly_site, os.environ.get("PYTHONPATH", "")]))
    cluster.add()

    def meanwhile(progress) -> None:
        if list((tmp_path / "out/parts").glob("*.parquet")):
            cluster.processes[0].send_signal(signal.SIGKILL)

    asked = RunRequest([str(tmp_path / "data")], Orders(str(tmp_path / "out")))
    with pytest.raises(InputError, match="continues where it stopped"):
        run(asked, Dask(str(cluster.file)), meanwhile)
    there = len(list((tmp_path / "out/results").glob("*.json")))
    again = run_fleet([tmp_path / "data"], tmp_path / "out")
    assert there
    assert again.computed < 11
    assert again.tally.statuses == {"identified": 10, "failed": 1}


@needs_dask
@pytest.mark.parametrize(
    ("where", "said"), [("tcp://127.0.0.1:1", "imed out"), ("n.json", "no file"), ("n", "no port")]
)
def test_a_scheduler_that_is_not_there_is_said(where, said, monkeypatch):
    monkeypatch.setattr(Dask, "_PATIENCE_S", 1.0)
    with pytest.raises(InputError, match="No scheduler answers") as refused:
        Dask(where)
    assert said in refused.value.found


def _numbers(row: dict) -> dict:
    return {name: value for name, value in row.items() if name != "seconds"}

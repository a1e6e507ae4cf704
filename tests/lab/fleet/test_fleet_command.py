"""``vibrident fleet`` in a shell: killed at any moment, beside itself, into a history; its exit codes."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from tests.support.fleets import broken, deadly, fleet, good
from tests.support.shell import run as shell

#: Where the tests are run in the background, a shell has made them deaf to an interrupt.
HEARING = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
COMMAND = [sys.executable, "-c", f"{HEARING}; from vibrident.app.cli import main; main()", "fleet"]


def start(site: str, *arguments: object) -> subprocess.Popen[str]:
    """The command in a process of its own, with nothing installed beside what vibrident needs."""
    paths = os.pathsep.join([site, *filter(None, sys.path)])
    environment = {**os.environ, "PYTHONPATH": paths, "WITHOUT_EXTRAS": "1"}
    command = [*COMMAND, *(str(one) for one in arguments)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def end(process: subprocess.Popen[str], code: int) -> tuple[str, str]:
    out, err = process.communicate(timeout=240)
    assert process.returncode == code, err
    return out, err


def keys(parts: Path) -> list[str]:
    return [key for part in parts.glob("*.parquet") for key in pq.read_table(part, columns=["key"])["key"].to_pylist()]


def children(parent: int | None = None) -> set[str]:
    """Numbers of processes that identify, of one parent or of any, that are not ended yet."""
    listed = subprocess.run(["ps", "-eo", "pid,ppid,stat,args"], capture_output=True, text=True, check=False).stdout
    found = (line.split(None, 3) for line in listed.splitlines()[1:] if "vibrident.base.process" in line)
    return {pid for pid, of, state, _ in found if parent in (None, int(of)) and not state.startswith("Z")}


def all_end(processes: set[str]) -> bool:
    """Whether they end soon: a busy machine takes its time."""
    until = time.monotonic() + 20
    while (left := processes & children()) and time.monotonic() < until:
        time.sleep(0.1)
    return not left


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.draws(1, 2)
def test_killed_it_goes_on_and_two_at_once_do_no_harm(tmp_path, deadly_site, draws):
    fleet(tmp_path / "data/good", 2)
    broken(tmp_path / "data/broken")
    deadly(tmp_path / "data/slow", *(f"{number}-slow" for number in range(2)))
    arguments = (tmp_path / "data", "--out", tmp_path / "out", "--workers", 1)
    when, there = random.Random(7), []
    for _ in range(draws):
        process = start(deadly_site, *arguments)
        begun, until = len(there and keys(tmp_path / "out/parts")), time.monotonic() + 60
        while len(keys(tmp_path / "out/parts")) == begun and process.poll() is None and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(when.uniform(0.0, 0.3))
        beside = children(process.pid)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert all_end(beside)
        there.append(len(keys(tmp_path / "out/parts")))
    first, second = start(deadly_site, *arguments, "-q"), start(deadly_site, *arguments, "-q")
    end(first, 0)
    end(second, 0)
    rows = pq.read_table(tmp_path / "out/fleet.parquet").to_pylist()
    assert there == sorted({*there})
    assert 0 < there[0] <= there[-1] < len(rows) == 14
    assert len({row["calibration"] for row in rows}) == len({row["key"] for row in rows}) == 14
    assert sorted(row["status"] for row in rows) == ["identified"] * 4 + ["refused"] * 10
    assert not list((tmp_path / "out").rglob("*.json.part"))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signal")
def test_an_interrupt_ends_with_130_and_leaves_no_process(tmp_path, deadly_site):
    deadly(tmp_path / "data", "hangs")
    process = start(deadly_site, tmp_path / "data", "--out", tmp_path / "out", "--workers", 1)
    until = time.monotonic() + 60
    while not (tmp_path / "data/hangs/begun").exists() and time.monotonic() < until:
        time.sleep(0.05)
    beside = children(process.pid)
    process.send_signal(signal.SIGINT)
    end(process, 130)
    assert beside
    assert all_end(beside)


def test_strict_and_store_and_bad_options(tmp_path, here, pageless):
    good(tmp_path / "data/a", 1)
    nameless = good(tmp_path / "data/b", 2)
    nameless.write_text(
        nameless.read_text(encoding="utf-8").replace('serial_number = "SN0002"\n', ""), encoding="utf-8"
    )
    arguments = ("fleet", tmp_path / "data", "--out", tmp_path / "out", "--workers", "1")
    done = shell(*arguments, "--store", tmp_path / "history.db", "--strict")
    assert done.exit_code == 0, done.output
    assert "1 new result." in done.output
    assert "1 result states no serial number and was not added" in done.output
    listed = shell("history", "list", "--store", tmp_path / "history.db", "--format", "json")
    assert "SN0001" in json.dumps(json.loads(listed.stdout))
    again = shell(*arguments, "--store", tmp_path / "history.db")
    assert "0 new results" in again.output
    assert "Nothing was left to compute" in again.output
    (tmp_path / "data/a/frf.csv").write_text("")
    strict = shell(*arguments, "--strict")
    assert (strict.exit_code, "1 of 2 calibrations" in strict.output) == (3, True)
    for wrong, said in (
        (("--model", "akzelerometer"), "did you mean"),
        (("--estimator", "mll"), "did you mean"),
        (("--scheduler", "tcp://x:1"), "two ways"),
        (("--time-limit", "0"), "a number from 0.001"),
        (("--limits", tmp_path / "none.toml"), "no file of that name"),
        (("--store", tmp_path / "history.db", "--no-results"), "whole results"),
    ):
        refused = shell(*arguments, *wrong)
        assert (refused.exit_code, said in refused.output) == (2, True), refused.output

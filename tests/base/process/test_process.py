"""A function called in another process: what comes back, what may not, and that nothing stays behind."""

import io
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from vibrident.base import parcel
from vibrident.base.errors import InputError
from vibrident.base.process import Limits, Process, ProcessDied, ProcessEnded, WorkerError, processors
from vibrident.data.records import Provenance, Record

MEMORY = 400_000_000
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no process groups")
#: An owner that starts a process, makes it start another one, says which, and waits.
OWNER = f"""
import sys, threading, time
from vibrident.base.process import Process
from {__name__} import with_a_child

process = Process()
threading.Thread(target=process.call, args=(with_a_child, sys.argv[1]), daemon=True).start()
time.sleep(60)
"""


def greedy() -> int:
    return np.ones(10 * MEMORY, dtype=np.uint8).size


def twice(value: float, *, progress) -> float:
    progress("half", value)
    return 2 * value


def with_a_child(place: str) -> None:
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    Path(place).with_suffix(".part").write_text(f"{os.getpid()} {child.pid}")
    Path(place).with_suffix(".part").rename(place)
    child.wait()


def garbage() -> None:
    os.write(os.open("/proc/self/fd/3", os.O_WRONLY), b"no JSON\n")


def endless() -> str:
    return "9" * 20_000_000


def running(pid: int) -> bool:
    """Whether a process has not ended; one that has, and that nobody asked about, is a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def appears(place: Path) -> list[int]:
    until = time.monotonic() + 30
    while not place.exists() and time.monotonic() < until:
        time.sleep(0.02)
    return [int(pid) for pid in place.read_text().split()]


def end_soon(pids: list[int]) -> bool:
    until = time.monotonic() + 20
    while any(map(running, pids)) and time.monotonic() < until:
        time.sleep(0.02)
    return not any(map(running, pids))


def test_one_process_takes_many_calls_and_another_one_takes_over_when_it_died():
    told = []
    with Process() as process:
        assert process.call(twice, 1.5, progress=lambda *step: told.append(step)) == 3.0
        first = process.call(os.getpid)
        assert process.call(os.getpid) == first != os.getpid()
        with pytest.raises(ProcessDied, match="status 7") as caught:
            process.call(os._exit, 7)
        assert caught.value.reason == "crash"
        assert process.call(os.getpid) != first
        with pytest.raises(InputError, match="no file of that name"):
            process.call(refuse)
    assert told == [("half", 1.5)]
    assert not process.alive


def refuse() -> None:
    raise InputError("no file of that name", found="nothing")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the memory of a process")
def test_what_needs_too_much_memory_or_answers_endlessly_dies_and_the_next_call_works():
    with Process() as process:
        for task, limits in ((greedy, Limits(20.0, MEMORY)), (endless, Limits(answer_bytes=1_000_000))):
            with pytest.raises(ProcessDied) as caught:
                process.call(task, limits=limits)
            assert caught.value.reason == "memory"
        assert process.call(os.getpid)


@POSIX
def test_time_ends_a_call_and_all_that_it_started(tmp_path):
    with Process() as process:
        process.call(os.getpid)  # it runs
        with pytest.raises(ProcessDied) as caught:
            process.call(with_a_child, str(tmp_path / "pids"), limits=Limits(seconds=1.0))
    assert caught.value.reason == "time"
    assert end_soon(appears(tmp_path / "pids"))


@POSIX
def test_another_thread_ends_it_for_good(tmp_path):
    process = Process()
    threading.Thread(target=lambda: (appears(tmp_path / "pids"), process.end())).start()
    with pytest.raises(ProcessEnded):
        process.call(with_a_child, str(tmp_path / "pids"))
    assert end_soon(appears(tmp_path / "pids"))
    with pytest.raises(ProcessEnded):
        process.call(os.getpid)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_it_ends_when_its_owner_is_killed(tmp_path):
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    owner = subprocess.Popen([sys.executable, "-c", OWNER, str(tmp_path / "pids")], env=paths)
    child, _ = appears(tmp_path / "pids")
    owner.kill()
    owner.wait()
    assert end_soon([child])


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_an_answer_that_is_none_is_a_failure_of_the_process():
    with Process() as process, pytest.raises(WorkerError, match="cannot be read"):
        process.call(garbage)


def test_it_ends_when_it_is_idle():
    with Process(idle_s=0.2) as process:
        process.call(os.getpid)
        until = time.monotonic() + 20
        while process.alive and time.monotonic() < until:
            time.sleep(0.02)
        assert not process.alive


@pytest.mark.parametrize(("quota", "expected"), [("150000 100000", 2), ("max 100000", 8), ("900000 100000", 8)])
def test_processors_are_those_of_the_container(monkeypatch, quota, expected):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: quota)
    assert processors() == expected


VALUES = [
    {"a": [1, 2.5, None, True, "µ"], 3: (np.inf, b"bytes", Path("x/y")), "deep": {"t": ((),)}},
    np.arange(6.0).reshape(2, 3).T,
    np.zeros(0, dtype=np.int16),
    Record("r", np.arange(9.0), np.ones(9), 1000.0, "random", provenance=Provenance("r.csv", "00", ("step",))),
]


@pytest.mark.parametrize("value", VALUES)
def test_a_parcel_gives_back_what_went_in(value):
    stream = io.BytesIO()
    parcel.send(stream, value)
    parcel.send(stream, "the next one")
    stream.seek(0)
    back = parcel.receive(stream, 10_000)
    assert parcel.receive(stream, 10_000) == "the next one"
    assert repr(back) == repr(value)
    if isinstance(value, Record):
        np.testing.assert_array_equal(back.response, value.response)


HOSTILE = [
    ["dataclass", "subprocess", "Popen", [["args", "id"]]],
    ["dataclass", "vibrident.base.sandbox", "subprocess.Popen", [["args", "id"]]],
    ["dataclass", "vibrident.base.sandbox", "Path", []],
    ["array", "|O", [1], 8],
    ["array", "<f8", [1 << 40], 1 << 43],
    ["bytes", -1],
    ["object"],
    ["mapping", [["list"], 1]],
]


@pytest.mark.parametrize("tree", HOSTILE)
def test_a_parcel_makes_nothing_but_data(tree):
    line = json.dumps([64, tree]).encode()
    with pytest.raises((ValueError, TypeError)):
        parcel.receive(io.BytesIO(line + b"\n" + bytes(64)), 10_000)


@pytest.mark.parametrize(
    ("sent", "error"),
    [
        (b"9" * 20_000, parcel.TooLong),
        (b"[20000, 1]\n", parcel.TooLong),
        (b"[-1, 1]\n", parcel.TooLong),
        (b"[8, 1]\n1234", EOFError),
        (b"[0, 1]", EOFError),
        (b"no JSON\n", ValueError),
        (b"[0, " + b"[" * 9_000 + b"\n", RecursionError),
    ],
)
def test_a_parcel_that_is_cut_short_or_endless_is_refused(sent, error):
    with pytest.raises(error):
        parcel.receive(io.BytesIO(sent), 10_000)

"""What a file may cost, and what may come back from the process that reads it."""

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from vibrident.base import sandbox
from vibrident.base.errors import InputError
from vibrident.base.process import Limits, WorkerError
from vibrident.data.io.guess import guess_columns

MEMORY, SECONDS = 400_000_000, 20.0
LIMITS = Limits(SECONDS, MEMORY, 0)
LIMITED = pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the memory of a process")


def greedy() -> int:
    return np.ones(10 * MEMORY, dtype=np.uint8).size


def slow() -> None:
    while True:
        time.sleep(0.01)


def crash() -> None:
    os.abort()


def broken() -> None:
    raise KeyError("a bug")


def unsendable() -> object:
    return object()


def write(path: Path) -> None:
    path.write_text("anything")


def prepare() -> None:
    print("what a library prints when it is loaded")


def noisy() -> int:
    print("what a library prints")
    os.write(1, b"or a C library")
    return 3


@pytest.mark.parametrize(
    ("function", "seconds", "words"),
    [
        pytest.param(greedy, SECONDS, "400 MB of memory", marks=LIMITED),
        (slow, 0.5, "takes longer"),
        (crash, SECONDS, "crashed"),
    ],
)
def test_what_costs_too_much_or_crashes_is_bad_input(function, seconds, words):
    with pytest.raises(InputError, match=words) as caught:
        sandbox.run(function, limits=Limits(seconds, MEMORY, 0))
    assert all(vars(caught.value)[part] for part in ("problem", "expected", "found", "remedy"))


@pytest.mark.parametrize(("function", "words"), [(broken, "a bug"), (unsendable, "cannot be sent")])
def test_a_bug_keeps_its_traceback(function, words):
    with pytest.raises(WorkerError, match=words):
        sandbox.run(function, limits=LIMITS)


def test_the_process_prints_nothing_and_writes_nothing(tmp_path):
    assert sandbox.run(noisy, limits=LIMITS) == 3
    if sys.platform != "win32":
        with pytest.raises(WorkerError, match="File too large"):
            sandbox.run(write, tmp_path / "x", limits=LIMITS)


def test_a_reader_in_the_process_says_what_it_says_outside(tmp_path):
    good, bad = tmp_path / "good.csv", tmp_path / "bad.csv"
    good.write_text("time,reference,response\n" + "".join(f"{i / 1000},{i},{2 * i}\n" for i in range(50)))
    bad.write_text("only text\n")
    assert sandbox.run(guess_columns, good, limits=LIMITS) == guess_columns(good)
    with pytest.raises(InputError) as here:
        guess_columns(bad)
    with pytest.raises(InputError) as there:
        sandbox.run(guess_columns, bad, limits=LIMITS)
    assert str(here.value) == str(there.value)


def test_a_process_started_ahead_works_once_and_is_as_safe():
    ready = sandbox.WarmProcess(prepare)
    try:
        ready.prepare()
        first = ready.run(os.getpid, limits=LIMITS)
        assert ready.run(os.getpid, limits=LIMITS) != first
        with pytest.raises(InputError, match="crashed"):
            ready.run(crash, limits=LIMITS)
        assert ready.run(noisy, limits=LIMITS) == 3
    finally:
        ready.close()
    assert ready._waiting is None


def test_a_process_may_write_as_much_as_it_is_told(tmp_path):
    sandbox.run(write, tmp_path / "x", limits=Limits(SECONDS, MEMORY, 100))
    assert (tmp_path / "x").read_text() == "anything"

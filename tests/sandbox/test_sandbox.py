"""What a file may cost, and what may come back from the process that reads it."""

import json
import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from vibrident import parcel, sandbox
from vibrident.errors import InputError
from vibrident.io.guess import guess_columns
from vibrident.records import Provenance, Record

MEMORY, SECONDS = 400_000_000, 20.0
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


def noisy() -> int:
    print("what a library prints")
    os.write(1, b"or a C library")
    return 3


@pytest.mark.parametrize(
    ("function", "seconds", "words"),
    [
        pytest.param(greedy, SECONDS, "400 MB of memory", marks=LIMITED),
        (slow, 2.0, "takes longer"),
        (crash, SECONDS, "crashed"),
    ],
)
def test_what_costs_too_much_or_crashes_is_bad_input(function, seconds, words):
    with pytest.raises(InputError, match=words) as caught:
        sandbox.run(function, memory_bytes=MEMORY, seconds=seconds)
    assert all(vars(caught.value)[part] for part in ("problem", "expected", "found", "remedy"))


@pytest.mark.parametrize(("function", "words"), [(broken, "a bug"), (unsendable, "cannot be sent")])
def test_a_bug_keeps_its_traceback(function, words):
    with pytest.raises(sandbox.WorkerError, match=words):
        sandbox.run(function, memory_bytes=MEMORY, seconds=SECONDS)


def test_the_process_prints_nothing_and_writes_nothing(tmp_path):
    assert sandbox.run(noisy, memory_bytes=MEMORY, seconds=SECONDS) == 3
    if sys.platform != "win32":
        with pytest.raises(sandbox.WorkerError, match="File too large"):
            sandbox.run(write, tmp_path / "x", memory_bytes=MEMORY, seconds=SECONDS)


def test_a_reader_in_the_process_says_what_it_says_outside(tmp_path):
    good, bad = tmp_path / "good.csv", tmp_path / "bad.csv"
    good.write_text("time,reference,response\n" + "".join(f"{i / 1000},{i},{2 * i}\n" for i in range(50)))
    bad.write_text("only text\n")
    assert sandbox.run(guess_columns, good, memory_bytes=MEMORY, seconds=SECONDS) == guess_columns(good)
    with pytest.raises(InputError) as here:
        guess_columns(bad)
    with pytest.raises(InputError) as there:
        sandbox.run(guess_columns, bad, memory_bytes=MEMORY, seconds=SECONDS)
    assert str(here.value) == str(there.value)


def test_a_process_started_ahead_works_once_and_is_as_safe():
    ready = sandbox.Ready("vibrident.io.guess")
    try:
        ready.prepare()
        first = ready.run(os.getpid, memory_bytes=MEMORY, seconds=SECONDS)
        assert ready.run(os.getpid, memory_bytes=MEMORY, seconds=SECONDS) != first
        with pytest.raises(InputError, match="crashed"):
            ready.run(crash, memory_bytes=MEMORY, seconds=SECONDS)
        assert ready.run(noisy, memory_bytes=MEMORY, seconds=SECONDS) == 3
    finally:
        ready.close()
    assert ready._waiting is None


def test_a_process_may_write_as_much_as_it_is_told(tmp_path):
    sandbox.run(write, tmp_path / "x", memory_bytes=MEMORY, seconds=SECONDS, file_bytes=100)
    assert (tmp_path / "x").read_text() == "anything"


VALUES = [
    {"a": [1, 2.5, None, True, "µ"], 3: (np.inf, b"bytes", Path("x/y")), "deep": {"t": ((),)}},
    np.arange(6.0).reshape(2, 3).T,
    np.zeros(0, dtype=np.int16),
    Record("r", np.arange(9.0), np.ones(9), 1000.0, "random", provenance=Provenance("r.csv", "00", ("step",))),
]


@pytest.mark.parametrize("value", VALUES)
def test_a_parcel_gives_back_what_went_in(value):
    back = parcel.unpack(bytearray(b"".join(parcel.pack(value))))
    assert repr(back) == repr(value)
    if isinstance(value, Record):
        np.testing.assert_array_equal(back.response, value.response)


HOSTILE = [
    ["dataclass", "subprocess", "Popen", [["args", "id"]]],
    ["dataclass", "vibrident.sandbox", "subprocess.Popen", [["args", "id"]]],
    ["dataclass", "vibrident.sandbox", "Path", []],
    ["array", "|O", [1], 8],
    ["array", "<f8", [1 << 40], 1 << 43],
    ["bytes", -1],
    ["object"],
    ["mapping", [["list"], 1]],
]


@pytest.mark.parametrize("tree", HOSTILE)
def test_a_parcel_makes_nothing_but_data(tree):
    text = json.dumps(tree).encode()
    with pytest.raises((ValueError, TypeError)):
        parcel.unpack(bytearray(len(text).to_bytes(8, "little") + text + bytes(64)))

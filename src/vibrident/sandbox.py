"""A function run in its own process, with limits on memory and time: for untrusted files.

The process protects its caller from a file's cost (memory, time) and from a crash of a native library. It does not
confine code: it runs as the same user and may read that user's files. Its answer is data, never code: no pickle, only
numbers, text, containers, arrays and this package's dataclasses.
"""

from __future__ import annotations

import contextlib
import importlib
import math
import os
import pickle
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from vibrident import parcel
from vibrident.errors import InputError, NotConverged, VibridentError

_WORK = "from vibrident.sandbox import work; work()"
#: One thread of arithmetic, because the stack of each counts as memory; no HDF5 plug-ins, because they are code.
_SURROUNDINGS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "HDF5_PLUGIN_PRELOAD": "::"}
_LONGEST_TRACE = 20_000
_T = TypeVar("_T")


class WorkerError(RuntimeError):
    """An unexpected failure in the process; the message is its traceback."""


def run(function: Callable[..., _T], *args: Any, memory_bytes: int, seconds: float, file_bytes: int = 0) -> _T:
    """Run an importable function in a fresh process and return what it returns.

    It can be called from a thread. Without memory limits of the system (Windows, macOS), only the limit on time holds.

    Args:
        function: defined at the top of a module, which the process imports.
        args: anything that can be pickled; they come from the caller, who is trusted.
        memory_bytes: most memory beside the process's code; also the longest answer.
        seconds: most time, of the clock and of the processor.
        file_bytes: most bytes of a file that it writes; 0: none.

    Raises:
        InputError, NotConverged: as the function does; or it needs more memory or time, or crashed (InputError).
        WorkerError: anything else that the function raised.
    """
    return _run(_started(), function, args, memory_bytes, seconds, file_bytes)


class Ready:
    """Runs functions as ``run`` does, in a process that was started ahead with its libraries loaded.

    Each process runs one function. It can be used from several threads.

    Args:
        modules: what the process loads while it waits.
    """

    def __init__(self, *modules: str) -> None:
        self._modules = modules
        self._waiting: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        self._closed = False

    def prepare(self) -> None:
        """Start a process, unless one is waiting."""
        with self._lock:
            if not self._closed and (self._waiting is None or self._waiting.poll() is not None):
                self._waiting = _started(*self._modules)

    def run(
        self, function: Callable[..., _T], *args: Any, memory_bytes: int, seconds: float, file_bytes: int = 0
    ) -> _T:
        """As the function ``run``."""
        with self._lock:
            process, self._waiting = self._waiting, None
        if process is None or process.poll() is not None:
            process = _started(*self._modules)
        try:
            return _run(process, function, args, memory_bytes, seconds, file_bytes)
        finally:
            self.prepare()

    def close(self) -> None:
        """End the waiting process and start no other."""
        with self._lock:
            self._closed = True
            process, self._waiting = self._waiting, None
        if process is not None:
            _end(process)


def _started(*modules: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", "-B", "-c", _WORK, *modules],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **_SURROUNDINGS, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):  # the process may have died
                stream.close()


def _run(
    process: subprocess.Popen[bytes],
    function: Callable[..., _T],
    args: tuple[Any, ...],
    memory_bytes: int,
    seconds: float,
    file_bytes: int,
) -> _T:
    task = {
        "path": sys.path,
        "module": function.__module__,
        "name": function.__qualname__,
        "args": args,
        "limits": (memory_bytes, seconds, file_bytes),
    }
    overdue = threading.Event()
    alarm = threading.Timer(seconds, lambda: (overdue.set(), process.kill()))
    alarm.start()
    try:
        answer = _exchange(process, pickle.dumps(task), memory_bytes)
    finally:
        alarm.cancel()
        _end(process)
    return _outcome(answer, process.returncode, overdue.is_set(), memory_bytes, seconds)


def set_limits(memory_bytes: int, seconds: float | None = None, file_bytes: int | None = None) -> None:
    """Limit this process, if the system can: memory for data, processor time, file size."""
    try:
        import resource
    except ImportError:  # Windows
        return
    wanted: dict[int, int] = {resource.RLIMIT_CORE: 0, resource.RLIMIT_DATA: memory_bytes}
    if seconds is not None:
        wanted[resource.RLIMIT_CPU] = math.ceil(seconds)
    if file_bytes is not None:
        wanted[resource.RLIMIT_FSIZE] = file_bytes
    for what, most in wanted.items():
        _, hard = resource.getrlimit(what)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(what, (most, most))


def work() -> None:
    """Main of the process: load modules, read one task from stdin, write one answer to stdout."""
    for module in sys.argv[1:]:
        importlib.import_module(module)
    task = pickle.loads(sys.stdin.buffer.read())
    sys.path[:] = task["path"]
    stream = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # keep what libraries print out of the answer
    memory_bytes, seconds, file_bytes = task["limits"]
    set_limits(memory_bytes, seconds, file_bytes)
    for piece in _answer(task):
        stream.write(piece)
    stream.flush()
    os._exit(0)  # skip the libraries' exit handlers


def _answer(task: dict[str, Any]) -> list[bytes | memoryview]:
    try:
        function: Any = importlib.import_module(task["module"])
        for name in task["name"].split("."):
            function = getattr(function, name)
        return parcel.pack({"done": function(*task["args"])})
    except MemoryError:
        pass  # reported below, after its memory is freed
    except Exception as error:
        return parcel.pack(told(error))
    return parcel.pack({"memory": True})


def told(error: Exception) -> dict[str, Any]:
    """An error of a process as plain values."""
    if isinstance(error, InputError):
        return {"input": vars(error)}
    if isinstance(error, VibridentError):
        return {"error": str(error)}
    return {"unexpected": "".join(traceback.format_exception(error))[-_LONGEST_TRACE:]}


def raise_told(said: Mapping[str, Any]) -> None:
    """Raise the error that a process told; nothing if it told none.

    Raises:
        InputError, NotConverged: as in the process.
        WorkerError: any other error.
    """
    if "input" in said:
        raise InputError(**said["input"])
    if "error" in said:
        raise NotConverged(said["error"])
    if "unexpected" in said:
        raise WorkerError(said["unexpected"])


def _exchange(process: subprocess.Popen[bytes], task: bytes, most_bytes: int) -> bytearray | None:
    """Send the task and take the answer; None if it is too long."""
    assert process.stdin is not None
    assert process.stdout is not None
    answer = bytearray()
    with process.stdin, process.stdout:
        try:
            process.stdin.write(task)
            process.stdin.close()
        except BrokenPipeError:
            return answer
        while piece := process.stdout.read1(1 << 20):  # type: ignore[attr-defined]
            answer += piece
            if len(answer) > most_bytes:
                return None
    process.wait()
    return answer


def _outcome(answer: bytearray | None, code: int, overdue: bool, memory_bytes: int, seconds: float) -> Any:
    try:
        said: dict[str, Any] = {"memory": True} if answer is None else parcel.unpack(answer) if answer else {}
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise WorkerError(f"the answer cannot be read: {error}") from error
    if "done" in said:
        return said["done"]
    raise_told(said)
    if "memory" in said:
        raise _too_much(f"{memory_bytes / 1e6:.0f} MB of memory", "a file that needs more")
    if overdue or -code in _OUT_OF_TIME:
        raise _too_much(f"{seconds:.3g} s", "a file that takes longer")
    raise InputError(
        "The reader of this file crashed.",
        expected="a whole file of its format",
        found=f"a process that ended with {_ending(code)}",
        remedy="export the data again, or in another format such as CSV",
    )


def _too_much(expected: str, found: str) -> InputError:
    return InputError(
        "Reading this file costs too much.",
        expected=f"at most {expected}",
        found=found,
        remedy="give a shorter record, or use vibrident identify in a shell of your own machine",
    )


#: SIGXCPU of Linux and macOS.
_OUT_OF_TIME = (24,)


def _ending(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"status {code}"

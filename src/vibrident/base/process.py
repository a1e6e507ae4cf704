"""Call functions in another process, with limits on memory and time, progress, and errors.

Readers of untrusted files, identifications of the page and of fleets, and pictures use it. Calls
and answers are parcels over the pipes of the child. The child ends as soon as its stdin ends, even
during a call: the process that started it is gone.
"""

from __future__ import annotations

import contextlib
import math
import os
import pkgutil
import queue
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, TypeVar

from vibrident.base import parcel
from vibrident.base.errors import InputError, NotConverged, VibridentError
from vibrident.base.memory import ONE_THREAD, keep_freed

_WORK = "from vibrident.base.process import work; work()"
#: One thread of arithmetic, because the stack of each counts as memory. No plug-ins of HDF5: they
#: are foreign code.
_ENVIRONMENT = {
    **ONE_THREAD,
    "HDF5_PLUGIN_PRELOAD": "::",
    "XLA_PYTHON_CLIENT_PREALLOCATE": "false",  # processes share a GPU
}
_MAX_ANSWER_BYTES = 16_000_000  # an error may quote its input
_UNLIMITED_BYTES = 1 << 62  # of a call, whose sender is trusted
_MAX_TRACE_LENGTH = 20_000  # characters of a traceback
_MAX_PRINTED_BYTES = 20_000  # of the end of what a process printed
_ENDING_TIMEOUT_S = 5.0  # for a process that closed its output
_OUT_OF_TIME_CODE = -24  # SIGXCPU of Linux and macOS
#: Errors of an answer that was not written by :func:`parcel.send`.
_UNREADABLE_ERRORS = (ValueError, TypeError, KeyError, RecursionError)
_T = TypeVar("_T")


def _signal_text(number: int) -> str:
    """Return a signal's number and name: ``signal 9, SIGKILL``."""
    try:
        return f"signal {number}, {signal.Signals(number).name}"
    except ValueError:
        return f"signal {number}"


class WorkerError(RuntimeError):
    """Unexpected failure in the process; the message is its traceback."""


class ProcessEnded(Exception):
    """Raised by a call if the owner has ended the process."""


class ProcessDied(Exception):
    """Raised by a call during which the process ended or had to be ended.

    Attributes:
        reason: the process ran out of time or memory, or crashed.
        ending: how it ended, in words.
        printed: end of what it printed.
    """

    def __init__(
        self, reason: Literal["time", "memory", "crash"], ending: str, printed: str = ""
    ) -> None:
        super().__init__(f"{ending}\n{printed}".rstrip())
        self.reason: Literal["time", "memory", "crash"] = reason
        self.ending: str = ending
        self.printed: str = printed


@dataclass(frozen=True)
class Limits:
    """Limits of a call; None for no limit."""

    seconds: float | None = None  # elapsed time
    memory_bytes: int | None = None  # memory for data, where the system can limit it (Linux)
    file_bytes: int | None = None  # size of a file that the process writes
    answer_bytes: int = _MAX_ANSWER_BYTES  # length of a message from the process


NO_LIMITS = Limits()


class Process:
    """Process that calls importable functions, one at a time.

    It is started when needed, and again after it has ended.

    Args:
        prepare: called in the process before the first call, to load libraries.
        folder: working folder; None for that of this process.
        idle_s: seconds without a call after which it ends; None: with its owner.
        wrapper: command that confines it.
    """

    def __init__(
        self,
        prepare: Callable[[], None] | None = None,
        *,
        folder: Path | None = None,
        idle_s: float | None = None,
        wrapper: Sequence[str] = (),
    ) -> None:
        self._arguments = [
            "" if prepare is None else _address(prepare),
            "" if idle_s is None else str(idle_s),
        ]
        self._folder = folder
        self._wrapper = wrapper
        self._child: _Child | None = None
        self._ended = False
        self._lock = threading.Lock()  # held during a call

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def alive(self) -> bool:
        """Return whether a process is waiting for calls."""
        return self._child is not None and self._child.popen.poll() is None

    def start(self) -> None:
        """Start the process, unless it is alive.

        Raises:
            OSError: no process can be started.
            ProcessEnded: :meth:`end` was called.
        """
        if not self.alive:
            self.close()
            self._child = _Child(self._arguments, self._folder, self._wrapper)
        if self._ended:  # perhaps while it started
            self.close()
            raise ProcessEnded

    def call(
        self,
        function: Callable[..., _T],
        *args: Any,
        limits: Limits = NO_LIMITS,
        progress: Callable[..., object] | None = None,
    ) -> _T:
        """Call a function in the process and return its result.

        Args:
            function: defined at the top of a module, which the process imports.
            args: values that a parcel can hold.
            limits: of this call.
            progress: called with what the function passes to its argument of that name.

        Raises:
            ProcessDied: the process needs more memory or time than it may have, or crashed.
            ProcessEnded: :meth:`end` was called.
            WorkerError: the function raised another error, or its answer cannot be read.
            InputError, NotConverged: as the function raises them.
            OSError: no process can be started.
        """
        call = {
            "name": _address(function),
            "args": args,
            "limits": limits,
            "progress": progress is not None,
        }
        with self._lock:
            try:
                self.start()
                assert self._child is not None
                answer = self._child.answer(call, limits, progress or (lambda *_: None))
                if "memory" in answer:
                    raise ProcessDied("memory", "a process that asked for more")
            except Exception as error:
                self.close()
                if self._ended:
                    raise ProcessEnded from None
                if isinstance(error, _UNREADABLE_ERRORS):
                    raise WorkerError(f"the answer cannot be read: {error}") from error
                raise
            finally:
                if self._ended:
                    self.close()
        if "done" in answer:
            return answer["done"]
        raise _error_from_values(answer)

    def end(self) -> None:
        """End the process for good, from any thread; a call in progress raises ProcessEnded."""
        self._ended = True
        self.kill()
        if self._lock.acquire(blocking=False):  # else the call closes it
            try:
                self.close()
            finally:
                self._lock.release()

    def kill(self) -> None:
        """Kill the process and what it started, without waiting or taking a lock."""
        if (child := self._child) is not None:
            child.kill()

    def close(self) -> None:
        """End the process and what it started; the next call starts another."""
        child = self._child
        self._child = None
        if child is not None:
            child.close()


class _Child:
    """Child process of a :class:`Process`, from its start to its end."""

    def __init__(
        self, arguments: Sequence[str], folder: Path | None, wrapper: Sequence[str]
    ) -> None:
        self.popen = subprocess.Popen(
            # -P: no imports from the user's folder. In a session of its own Ctrl-C does not reach
            # it.
            [*wrapper, sys.executable, "-P", "-c", _WORK, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env={
                **os.environ,
                **_ENVIRONMENT,
                "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            },
            start_new_session=True,
        )
        assert self.popen.stdin is not None
        assert self.popen.stdout is not None
        self._calls = self.popen.stdin
        self._answers = self.popen.stdout
        self._printed = b""
        self._wrapped = bool(wrapper)
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def answer(
        self, call: Mapping[str, Any], limits: Limits, progress: Callable[..., object]
    ) -> dict[str, Any]:
        """Send a call; return the last message about it.

        Raises:
            ProcessDied: the process ended without one.
        """
        overdue = threading.Event()
        alarm = threading.Timer(limits.seconds or 0.0, lambda: (overdue.set(), self.kill()))
        alarm.daemon = True
        if limits.seconds is not None:
            alarm.start()
        try:
            parcel.send(self._calls, call)
            while "progress" in (answer := parcel.receive(self._answers, limits.answer_bytes)):
                progress(*answer["progress"])
            return answer
        except parcel.TooLong:
            return {"memory": True}
        except (EOFError, OSError):
            raise self._death(overdue) from None
        finally:
            alarm.cancel()

    def _death(self, overdue: threading.Event) -> ProcessDied:
        """Return how the process ended; ``overdue``: whether it ran out of time."""
        try:
            code = self.popen.wait(_ENDING_TIMEOUT_S)
        except subprocess.TimeoutExpired:  # it has closed its output, and goes on
            self.kill()
            code = self.popen.wait()
        code = 128 - code if self._wrapped and code > 128 else code  # a wrapper's code of a signal
        if overdue.is_set() or code == _OUT_OF_TIME_CODE:
            return ProcessDied("time", "a process that was still at work")
        self._listener.join(_ENDING_TIMEOUT_S)
        cause = _signal_text(-code) if code < 0 else f"status {code}"
        ending = f"a process that ended with {cause}"
        return ProcessDied("crash", ending, self._printed.decode(errors="replace").strip())

    def kill(self) -> None:
        """Kill the process and what it started."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if hasattr(os, "killpg"):
                os.killpg(self.popen.pid, signal.SIGKILL)
            else:
                self.popen.kill()

    def close(self) -> None:
        """Kill the process, and wait until it has ended."""
        self.kill()
        self.popen.wait()
        self._listener.join(_ENDING_TIMEOUT_S)
        for stream in (self._calls, self._answers):
            with contextlib.suppress(OSError):  # it died in the middle of a message
                stream.close()

    def _listen(self) -> None:
        """Store the end of what the process prints."""
        assert self.popen.stderr is not None
        with self.popen.stderr as stream:
            while block := os.read(stream.fileno(), _MAX_PRINTED_BYTES):
                self._printed = (self._printed + block)[-_MAX_PRINTED_BYTES:]


def processors() -> int:
    """Return how many processors this process may use, by affinity and quota of its container."""
    if hasattr(os, "sched_getaffinity"):
        count = len(os.sched_getaffinity(0))
    else:
        count = os.cpu_count() or 1
    with contextlib.suppress(OSError, ValueError):  # the quota "max" is no number
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text(encoding="ascii").split()
        count = min(count, math.ceil(int(quota) / int(period)))
    return count


def _address(function: Callable[..., Any]) -> str:
    """Return where a function is found: ``module:function``."""
    return f"{function.__module__}:{function.__qualname__}"


def work() -> None:
    """Run the child process: answer the owner's calls until stdin ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print must not mix with the answers
    calls: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=_take_calls, args=(calls,), daemon=True).start()
    prepare, idle_s = sys.argv[1:]
    if prepare:
        pkgutil.resolve_name(prepare)()
    while True:
        try:
            call = calls.get(timeout=float(idle_s) if idle_s else None)
        except queue.Empty:
            os._exit(0)
        _answer(call, answers)


def _take_calls(calls: queue.SimpleQueue[dict[str, Any]]) -> None:
    """Queue the calls that arrive on stdin; end the process with stdin, even during a call."""
    with contextlib.suppress(EOFError):
        while True:
            calls.put(parcel.receive(sys.stdin.buffer, _UNLIMITED_BYTES))
    os._exit(0)


def _answer(call: Mapping[str, Any], answers: IO[bytes]) -> None:
    """Execute a call and send its result, or its error."""
    set_limits(call["limits"])

    def progress(*values: Any) -> None:
        parcel.send(answers, {"progress": values})

    try:
        function = pkgutil.resolve_name(call["name"])
        keywords = {"progress": progress} if call["progress"] else {}
        parcel.send(answers, {"done": function(*call["args"], **keywords)})
        return
    except MemoryError:
        answer: dict[str, Any] = {"memory": True}
    except Exception as error:
        answer = _error_as_values(error)
    parcel.send(answers, answer)  # here, where the memory of the call is freed


def set_limits(limits: Limits) -> None:
    """Limit memory for data, file size and further processor time of this process, if possible.

    The limit of processor time ends a process whose owner is gone while a library holds the
    interpreter.
    """
    try:
        import resource
    except ImportError:  # Windows
        return
    limits_by_resource: dict[int, float | None] = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_DATA: limits.memory_bytes,
        resource.RLIMIT_FSIZE: limits.file_bytes,
    }
    if limits.seconds is not None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        limits_by_resource[resource.RLIMIT_CPU] = (
            used.ru_utime + used.ru_stime + limits.seconds * processors()
        )
    # Bytecode that is cut short would be loaded later.
    sys.dont_write_bytecode |= limits.file_bytes is not None
    for resource_id, limit in limits_by_resource.items():
        _, hard = resource.getrlimit(resource_id)
        if limit is not None:
            resource.setrlimit(
                resource_id,
                (math.ceil(limit if hard == resource.RLIM_INFINITY else min(limit, hard)), hard),
            )


def _error_as_values(error: Exception) -> dict[str, Any]:
    """Return an error as plain values."""
    if isinstance(error, InputError):
        return {"input": vars(error)}
    if isinstance(error, VibridentError):
        return {"error": str(error)}
    return {"unexpected": "".join(traceback.format_exception(error))[-_MAX_TRACE_LENGTH:]}


def _error_from_values(answer: Mapping[str, Any]) -> Exception:
    """Return the error that a process answered with."""
    if "input" in answer:
        return InputError(**answer["input"])
    if "error" in answer:
        return NotConverged(answer["error"])
    return WorkerError(answer.get("unexpected", "an answer without an outcome"))
